"""Events as sortable words, and the sort."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sensor.kernels.elementary import jit

# An event while it waits to be sorted, in one uint64: microseconds since the rounded start of its
# frame interval, polarity, row, column.
TIME_SHIFT = np.uint64(33)
POLARITY_SHIFT = np.uint64(32)
ROW_SHIFT = np.uint64(16)
COORDINATE_MASK = np.uint64(0xFFFF)
PLACE_MASK = np.uint64(0xFFFFFFFF)
MAX_INTERVAL_US = (1 << 31) - 2

# Where the events of one block, setting and interval lie in the pool.
START, STOP = range(2)
# In place of how much of the pool is used: it has no room for the events.
FULL = -1


class Interval(NamedTuple):
    """One frame interval of one setting."""

    dt_s: float
    drift: float  # what the memory sinks by over it, log units
    start_us: float  # how far its start lies after a whole microsecond, or before it
    length_us: int  # whole microseconds from its start to its end, both rounded


@jit
def place(start, width, position):
    """Write rows and columns of pixels in raster order, from the pixel `start` on."""
    y, x = start // width, start % width
    for i in range(position.size):
        position[i] = np.uint64(y) << ROW_SHIFT | np.uint64(x)
        x += 1
        if x == width:
            x = 0
            y += 1


@jit
def pack(since_us, start_us, length_us, polarity_and_position):
    """One event as a sortable word; the one place where a float time becomes microseconds.

    The event comes `since_us` after its interval starts. Rounding never takes it out of the
    interval.
    """
    t_us = np.int64(math.floor(start_us + since_us + 0.5))
    return (np.uint64(min(max(t_us, 0), length_us)) << TIME_SHIFT) | polarity_and_position


@jit
def gather(pool, segment, s, f, words, used):
    """Append one setting's and interval's events in one band, in raster order. Returns used."""
    for block in range(segment.shape[0]):
        for j in range(segment[block, s, f, START], segment[block, s, f, STOP]):
            words[used] = pool[j]
            used += 1
    return used


@jit
def sort_by_time(words, other, interval_us, start_us, columns):
    """Sort packed events by time, keeping raster order within a microsecond, and unpack them.

    A stable counting sort, digit by digit: one pass for intervals up to 4 ms. `other` is room for
    as many words again.
    """
    bits = 1
    while interval_us >> bits:
        bits += 1
    passes = (bits + 11) // 12
    digit_bits = np.uint64((bits + passes - 1) // passes)
    mask = (np.uint64(1) << digit_bits) - np.uint64(1)
    starts = np.empty((1 << digit_bits) + 1, np.int64)
    source, target = words, other
    for k in range(passes):
        shift = TIME_SHIFT + np.uint64(k) * digit_bits
        starts[:] = 0
        for word in source:
            starts[((word >> shift) & mask) + np.uint64(1)] += 1
        for digit in range(1, starts.size):
            starts[digit] += starts[digit - 1]
        for word in source:
            digit = (word >> shift) & mask
            target[starts[digit]] = word
            starts[digit] += 1
        source, target = target, source
    t_us, x, y, p = columns
    for k in range(source.size):
        word = source[k]
        t_us[k] = start_us + np.int64(word >> TIME_SHIFT)
        x[k] = word & COORDINATE_MASK
        y[k] = (word >> ROW_SHIFT) & COORDINATE_MASK
        p[k] = np.int8((word >> POLARITY_SHIFT) & np.uint64(1)) * 2 - 1
