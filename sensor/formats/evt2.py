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

from sensor.formats import evt, evt_words
from sensor.formats.compiling import jit
from sensor.formats.evt_words import Layout, held, turned

_WRAP = 1 << 28  # values of the high part


@jit
def encode(events, width, state, words):
    """Encode events until (m,) uint32 `words` are full; return how many of both are done."""
    t, x, y, p = events
    done = 0
    high = state[evt_words.HIGH]
    for i in range(t.size):
        target = t[i] >> 6
        while high < target:
            if done == words.size:
                state[evt_words.HIGH] = high
                return i, done
            # Start at 0 and write every wrap of the clock, since readers count them.
            if high < 0 or high % _WRAP == _WRAP - 1:
                high += 1
            else:
                high = min(target, high | (_WRAP - 1))
            words[done] = (8 << 28) | (high % _WRAP)
            done += 1
        if done == words.size:
            state[evt_words.HIGH] = high
            return i, done
        kind = np.int64(p[i] > 0)
        words[done] = (kind << 28) | ((t[i] & 63) << 22) | (np.int64(x[i]) << 11) | np.int64(y[i])
        done += 1
    state[evt_words.HIGH] = high
    return t.size, done


@jit
def decode(words, width, height, state, events):
    """Decode (m,) uint32 words until `events` is full or a word is wrong."""
    t, x, y, p = events
    done = 0
    high = state[evt_words.HIGH]
    last = state[evt_words.LAST_US]
    stop = evt_words.DONE
    i = 0
    while i < words.size:
        word = np.int64(words[i])
        kind = word >> 28
        if kind <= 1:
            if high < 0:
                state[evt_words.SKIPPED] += 1
            elif done == t.size:
                stop = evt_words.FULL
                break
            else:
                time = held((high << 6) | ((word >> 22) & 63), last, 6, state)
                column = (word >> 11) & 0x7FF
                row = word & 0x7FF
                if column >= width:
                    stop = evt_words.BAD_X
                    state[evt_words.FOUND] = column
                    break
                if row >= height:
                    stop = evt_words.BAD_Y
                    state[evt_words.FOUND] = row
                    break
                if time < last:
                    stop = evt_words.BACKWARDS
                    state[evt_words.FOUND] = time
                    break
                last = time
                t[done] = time
                x[done] = column
                y[done] = row
                p[done] = 2 * kind - 1
                done += 1
        elif kind == evt_words.HIGH_TIME:
            high = turned(high, word & (_WRAP - 1), _WRAP)
        elif kind != evt_words.TRIGGER and kind != 0xE and kind != 0xF:
            stop = evt_words.BAD_WORD
            break
        i += 1
    state[evt_words.HIGH] = high
    state[evt_words.LAST_US] = last
    return i, done, stop


LAYOUT = Layout(kind_shift=28, high_bits=28, low_bits=6, low_shift=22, channels=32)

CODEC = evt.Codec("EVT2", "2.0", np.uint32, LAYOUT, encode, decode)
