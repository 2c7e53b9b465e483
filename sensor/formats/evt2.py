"""Prophesee EVT2: one 32-bit word for each event, times in two parts.

    31..28  27..22      21..11  10..0
    0 / 1   t, low 6    x       y       an event, darker / brighter
    8       t, high 28                  microseconds / 64, modulo 2^28
    A       t, low 6    12..8 channel   a trigger; bit 0 is 1 for a rising edge

Words of the types OTHERS (E) and CONTINUED (F) are ignored. See
https://docs.prophesee.ai/stable/data/encoding_formats/evt2.html.
"""

from __future__ import annotations

import numpy as np

from sensor.formats import evt
from sensor.formats.compiling import jit
from sensor.formats.evt_words import (
    BACKWARDS,
    BAD_WORD,
    BAD_X,
    BAD_Y,
    DONE,
    FOUND,
    FULL,
    HIGH,
    HIGH_TIME,
    LAST_US,
    SKIPPED,
    TRIGGER,
    Layout,
    held,
    turned,
)

_WRAP = 1 << 28  # values of the high part


@jit
def encode(events, width, state, words):
    """Encode events until `words` is full.

    Parameters
    ----------
    state
        (STATE_SIZE,) int64, updated.
    words
        (m,) uint32 output.
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


@jit
def decode(words, width, height, state, events):
    """Decode words until `events` is full or a word is wrong.

    Parameters
    ----------
    words
        (m,) uint32.
    state
        (STATE_SIZE,) int64, updated.
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
                time = held((high << 6) | ((word >> 22) & 63), last, 6, state)
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
        elif kind == HIGH_TIME:
            high = turned(high, word & (_WRAP - 1), _WRAP)
        elif kind != TRIGGER and kind != 0xE and kind != 0xF:
            found = BAD_WORD
            break
        i += 1
    state[HIGH] = high
    state[LAST_US] = last
    return i, made, found


LAYOUT = Layout(kind_shift=28, high_bits=28, low_bits=6, low_shift=22, channels=32)

CODEC = evt.Codec("EVT2", "2.0", np.uint32, LAYOUT, encode, decode)
