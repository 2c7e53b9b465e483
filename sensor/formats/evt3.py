"""Prophesee EVT3: 16-bit words with the changes since the word before.

    15..12  11      10..0
    0               y           row of the next events
    2       p       x           an event
    3       p       x           start of the next vectors
    4       12 bits             vector: an event at start + i for each set bit i; start += 12
    5       8 bits              vector: the same with 8; start += 8
    6       t, low 12           microseconds
    8       t, high 12          microseconds / 4096, modulo 4096
    A       11..8 channel       a trigger; bit 0 is 1 for a rising edge

Words of inertial data (D), OTHERS (E) and CONTINUED (7, F) are ignored. Vectors are written in
groups of 12, 12 and 8 within the width of the sensor, if that is shorter than single events.
Cameras do the same, and OpenEB's decoder requires it. See
https://docs.prophesee.ai/stable/data/encoding_formats/evt3.html.
"""

from __future__ import annotations

import numpy as np

from sensor.formats import evt, evt_words
from sensor.formats.compiling import jit
from sensor.formats.evt_words import Layout, held, turned

_WRAP = 1 << 12  # values of the high part
_STRIDE = 1 << 10  # largest step of the high part in one word: some decoders refuse larger ones
_MAX_WORDS = 6  # for one event or one group of vectors: time, row, start, three vectors


@jit
def encode(events, width, state, words):
    """Encode events until (m,) uint16 `words` are full; return how many of both are done."""
    t, x, y, p = events
    done = 0
    i = 0
    while i < t.size and done + _MAX_WORDS <= words.size:
        high = state[evt_words.HIGH]
        target = t[i] >> 12
        if high < target:
            # Start at 0 and write every wrap of the clock, since readers count them.
            if high < 0 or high % _STRIDE == _STRIDE - 1:
                high += 1
            else:
                high = min(target, high | (_STRIDE - 1))
            words[done] = (8 << 12) | (high % _WRAP)
            done += 1
            state[evt_words.HIGH] = high
            state[evt_words.LOW] = -1
            continue
        low = t[i] & 0xFFF
        if low != state[evt_words.LOW]:
            words[done] = (6 << 12) | low
            done += 1
            state[evt_words.LOW] = low
        row = np.int64(y[i])
        if row != state[evt_words.Y]:
            words[done] = row
            done += 1
            state[evt_words.Y] = row
        first = np.int64(x[i])
        polarity = np.int64(p[i] > 0)
        # Events for one group of vectors: from left to right, within 32 pixels.
        bits = np.int64(1)
        after = i + 1
        if first + 32 <= width:
            while (
                after < t.size
                and t[after] == t[i]
                and y[after] == y[i]
                and p[after] == p[i]
                and x[after] > x[after - 1]
                and np.int64(x[after]) < first + 32
            ):
                bits |= np.int64(1) << (np.int64(x[after]) - first)
                after += 1
        new_base = state[evt_words.BASE_X] != first or state[evt_words.BASE_P] != polarity
        if after - i > 3 + np.int64(new_base):
            if new_base:
                words[done] = (3 << 12) | (polarity << 11) | first
                done += 1
            words[done] = (4 << 12) | (bits & 0xFFF)
            words[done + 1] = (4 << 12) | ((bits >> 12) & 0xFFF)
            words[done + 2] = (5 << 12) | (bits >> 24)
            done += 3
            state[evt_words.BASE_X] = first + 32
            state[evt_words.BASE_P] = polarity
            i = after
        else:
            words[done] = (2 << 12) | (polarity << 11) | first
            done += 1
            i += 1
    return i, done


@jit
def decode(words, width, height, state, events):
    """Decode (m,) uint16 words until `events` is full or a word is wrong."""
    t, x, y, p = events
    done = 0
    high = state[evt_words.HIGH]
    low = state[evt_words.LOW]
    row = state[evt_words.Y]
    base = state[evt_words.BASE_X]
    base_p = state[evt_words.BASE_P]
    last = state[evt_words.LAST_US]
    stop = evt_words.DONE
    i = 0
    while i < words.size:
        word = np.int64(words[i])
        kind = word >> 12
        if kind == 2 or kind == 4 or kind == 5:
            if kind == 2:
                size = 1
                bits = np.int64(1)
                first = word & 0x7FF
                polarity = (word >> 11) & 1
            else:
                size = 12 if kind == 4 else 8
                bits = word & ((1 << size) - 1)
                first = base
                polarity = base_p
            if high < 0 or row < 0:
                while bits:
                    state[evt_words.SKIPPED] += bits & 1
                    bits >>= 1
            else:
                if done + size > t.size:
                    stop = evt_words.FULL
                    break
                time = held((high << 12) | low, last, 12, state)
                if first < 0:
                    stop = evt_words.NO_BASE
                    break
                if row >= height:
                    stop = evt_words.BAD_Y
                    state[evt_words.FOUND] = row
                    break
                if time < last:
                    stop = evt_words.BACKWARDS
                    state[evt_words.FOUND] = time
                    break
                column = first
                while bits:
                    if bits & 1:
                        if column >= width:
                            stop = evt_words.BAD_X
                            state[evt_words.FOUND] = column
                            break
                        t[done] = time
                        x[done] = column
                        y[done] = row
                        p[done] = 2 * polarity - 1
                        done += 1
                        last = time
                    bits >>= 1
                    column += 1
                if stop == evt_words.BAD_X:
                    break
            if kind != 2 and base >= 0:
                base += size
        elif kind == evt_words.LOW_TIME:
            low = word & 0xFFF
        elif kind == 0:
            row = word & 0x7FF
        elif kind == evt_words.HIGH_TIME:
            before = high
            high = turned(high, word & (_WRAP - 1), _WRAP)
            if high != before:
                low = 0
        elif kind == 3:
            base = word & 0x7FF
            base_p = (word >> 11) & 1
        elif kind != 7 and kind != evt_words.TRIGGER and kind < 0xD:
            stop = evt_words.BAD_WORD
            break
        i += 1
    state[evt_words.HIGH] = high
    state[evt_words.LOW] = low
    state[evt_words.Y] = row
    state[evt_words.BASE_X] = base
    state[evt_words.BASE_P] = base_p
    state[evt_words.LAST_US] = last
    return i, done, stop


LAYOUT = Layout(kind_shift=12, high_bits=12, low_bits=12, low_shift=-1, channels=16)

CODEC = evt.Codec("EVT3", "3.0", np.uint16, LAYOUT, encode, decode)
