"""Prophesee EVT2: one 32-bit word for each event, times in two parts.

    31..28  27..22      21..11  10..0
    0 / 1   t, low 6    x       y       an event, darker / brighter
    8       t, high 28                  microseconds / 64, modulo 2^28
    A       t, low 6    12..8 channel   a trigger; bit 0 is 1 for a rising edge

Words of others (E) and continuations (F) are ignored. See
https://docs.prophesee.ai/stable/data/encoding_formats/evt2.html.
"""

from __future__ import annotations

import numba
import numpy as np

from sensor.formats import evt
from sensor.formats.evt import (
    BACKWARDS,
    BAD_WORD,
    BAD_X,
    BAD_Y,
    DONE,
    FOUND,
    FULL,
    HIGH,
    LAST_US,
    SKIPPED,
    TRIGGER,
)

_WRAP = 1 << 28  # values of the high part


@numba.njit(cache=True, nogil=True)
def encode(events, width, state, words):
    """Encode events until `words` is full.

    Parameters
    ----------
    events, width
        `Columns`, and width of the sensor.
    state
        (STATE_SIZE,) int64, updated.
    words
        (m,) uint32 output.

    Returns
    -------
    events taken, words made
    """
    t, x, y, p = events
    made = 0
    high = state[HIGH]
    for i in range(t.size):
        target = t[i] >> 6
        while high < target:
            if made == words.size:
                state[HIGH] = high
                return i, made
            # Start at 0 and write every wrap of the clock, since readers count them.
            if high < 0 or high % _WRAP == _WRAP - 1:
                high += 1
            else:
                high = min(target, high | (_WRAP - 1))
            words[made] = (8 << 28) | (high % _WRAP)
            made += 1
        if made == words.size:
            state[HIGH] = high
            return i, made
        kind = np.int64(p[i] > 0)
        words[made] = (kind << 28) | ((t[i] & 63) << 22) | (np.int64(x[i]) << 11) | np.int64(y[i])
        made += 1
    state[HIGH] = high
    return t.size, made


@numba.njit(cache=True, nogil=True)
def decode(words, width, height, state, events):
    """Decode words until `events` is full or a word is wrong.

    Parameters
    ----------
    words
        (m,) uint32.
    width, height
        Size of the sensor.
    state
        (STATE_SIZE,) int64, updated.
    events
        `Columns`, output.

    Returns
    -------
    words taken, events made, why it stopped (DONE, FULL, ...)
    """
    t, x, y, p = events
    made = 0
    high = state[HIGH]
    last = state[LAST_US]
    found = DONE
    i = 0
    while i < words.size:
        word = np.int64(words[i])
        kind = word >> 28
        if kind <= 1:
            if high < 0:
                state[SKIPPED] += 1
            elif made == t.size:
                found = FULL
                break
            else:
                time = (high << 6) | ((word >> 22) & 63)
                column = (word >> 11) & 0x7FF
                row = word & 0x7FF
                if column >= width:
                    found = BAD_X
                    state[FOUND] = column
                    break
                if row >= height:
                    found = BAD_Y
                    state[FOUND] = row
                    break
                if time < last:
                    found = BACKWARDS
                    state[FOUND] = time
                    break
                last = time
                t[made] = time
                x[made] = column
                y[made] = row
                p[made] = 2 * kind - 1
                made += 1
        elif kind == 8:
            high = _turned(high, word & (_WRAP - 1))
        elif kind != TRIGGER and kind != 0xE and kind != 0xF:
            found = BAD_WORD
            break
        i += 1
    state[HIGH] = high
    state[LAST_US] = last
    return i, made, found


@numba.njit(cache=True, nogil=True)
def _turned(high, new):
    """Return the high part of the time after a clock word; count wraps of the clock."""
    if high < 0:
        return new
    before = high % _WRAP
    turn = _WRAP if before - new >= _WRAP // 2 else 0
    return high + turn + new - before


@numba.njit(cache=True, nogil=True)
def decode_triggers(words, state, t_us, channel, p):
    """Decode the triggers of all words; those before the first word of time are skipped.

    Parameters
    ----------
    words
        (m,) uint32.
    state
        (STATE_SIZE,) int64, updated.
    t_us, channel, p
        Columns of `Triggers`, output, with room for all.

    Returns
    -------
    Number of triggers.
    """
    made = 0
    high = state[HIGH]
    for each in words:
        word = np.int64(each)
        kind = word >> 28
        if kind == 8:
            high = _turned(high, word & (_WRAP - 1))
        elif kind == TRIGGER and high >= 0:
            t_us[made] = (high << 6) | ((word >> 22) & 63)
            channel[made] = (word >> 8) & 31
            p[made] = 1 if word & 1 else -1
            made += 1
    state[HIGH] = high
    return made


CODEC = evt.Codec("EVT2", "2.0", np.uint32, encode, decode, decode_triggers, 63 << 22, 32)
