"""What the words of EVT2 and EVT3 have in common: the clock, the triggers, a decoder's state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sensor.formats.compiling import jit

# Reasons why a decoder stopped; see `decode` in `evt2` and `evt3`.
DONE, FULL, BAD_X, BAD_Y, BACKWARDS, BAD_WORD, NO_BASE = range(7)

# Entries of the state of a codec. Each codec uses those that it needs.
HIGH, LOW, Y, BASE_X, BASE_P, LAST_US, SKIPPED, FOUND, HELD, STEP_BACK_US = range(10)
STATE_SIZE = 10

# Types of words.
LOW_TIME = 6  # in EVT3
HIGH_TIME = 8
TRIGGER = 0xA  # its lowest bit is the edge

CHANNEL_SHIFT = 8  # place of the channel in a trigger


class Layout(NamedTuple):
    """Sizes and places in the words of one version, in bits.

    The type is in the highest four bits, from `kind_shift`. `low_shift` is the place of the low
    part of the time in the words of events and triggers; -1 if it has its own words. `channels` is
    the number of trigger inputs, a power of 2.
    """

    kind_shift: int
    high_bits: int
    low_bits: int
    low_shift: int
    channels: int

    @property
    def time_bits(self) -> int:
        """The bits of the time in the words of events and triggers."""
        return 0 if self.low_shift < 0 else ((1 << self.low_bits) - 1) << self.low_shift


@jit
def turned(high, new, wrap):
    """Return the high part of the time after a word of the clock; count wraps of the clock."""
    if high < 0:
        return new
    before = high % wrap
    turn = wrap if before - new >= wrap // 2 else 0
    return high + turn + new - before


@jit
def held(time, last, low_bits, state):
    """Return the time of an event, or of the event before it if the low part stepped back.

    Some cameras write a low part that is a little smaller than the last, without a new high part.
    The clock then stands still until it catches up; `state` counts such events and holds their
    largest step. If the high part steps back, the time is returned as it is.
    """
    if time >= last or time >> low_bits != last >> low_bits:
        return time
    state[HELD] += 1
    state[STEP_BACK_US] = max(state[STEP_BACK_US], last - time)
    return last


@jit
def decode_triggers(words, layout, state, t_us, channel, p):
    """Decode the triggers of all words; triggers before the first word of time are skipped."""
    wrap = 1 << layout.high_bits
    low_values = 1 << layout.low_bits
    count = 0
    high = state[HIGH]
    low = state[LOW]
    last = state[LAST_US]
    for each in words:
        word = np.int64(each)
        kind = word >> layout.kind_shift
        if kind == LOW_TIME and layout.low_shift < 0:
            low = word % low_values
        elif kind == HIGH_TIME:
            before = high
            high = turned(high, word % wrap, wrap)
            if high != before:
                low = 0
        elif kind == TRIGGER and high >= 0:
            if layout.low_shift >= 0:
                low = (word >> layout.low_shift) % low_values
            time = (high << layout.low_bits) | low
            if time < last and last >> layout.low_bits == high:
                time = last  # as `held` does for events
            last = time
            t_us[count] = time
            channel[count] = (word >> CHANNEL_SHIFT) % layout.channels
            p[count] = 1 if word & 1 else -1
            count += 1
    state[HIGH] = high
    state[LOW] = low
    state[LAST_US] = last
    return count
