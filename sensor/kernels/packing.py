"""Pack events into sortable 64-bit words, and sort them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sensor.kernels.elementary import allocating, jit

# Layout of an unsorted event in one uint64: microseconds since the rounded start of its frame
# interval, polarity, row, column.
TIME_SHIFT = np.uint64(33)
POLARITY_SHIFT = np.uint64(32)
ROW_SHIFT = np.uint64(16)
COORDINATE_MASK = np.uint64(0xFFFF)
PLACE_MASK = np.uint64(0xFFFFFFFF)
MAX_INTERVAL_US = (1 << 31) - 2
# `spread` sorts intervals shorter than SHORT_INTERVAL_US, of sensors with at most FEW_ROWS rows, in
# one pass; its words are polarity, row, column in a uint32.
SHORT_INTERVAL_US = 4096
FEW_ROWS = 1 << 15
ROW_MASK = np.uint32(0x7FFF)

# Columns of a segment: the range of the pool that holds the events of one block, setting, interval.
START, STOP = range(2)
# Returned instead of the used size of the pool when the pool is full.
FULL = -1


class Interval(NamedTuple):
    """One frame interval of one setting."""

    dt_s: float
    drift: float  # fall of the memory over the interval by leakage, log units
    start_us: float  # exact start minus rounded start
    length_us: int  # rounded end minus rounded start


@jit
def place(start, width, position):
    """Write the packed positions of consecutive pixels in raster order.

    Parameters
    ----------
    start
        Index of the first pixel.
    width
        Width of the sensor, px.
    position
        (n,) uint64 output, row and column in the low 32 bits.
    """
    y, x = start // width, start % width
    for i in range(position.size):
        position[i] = np.uint64(y) << ROW_SHIFT | np.uint64(x)
        x += 1
        if x == width:
            x = 0
            y += 1


@jit
def pack(since_us, start_us, length_us, polarity_and_position):
    """Pack one event into a sortable word; only here is its time rounded to whole microseconds.

    Parameters
    ----------
    since_us
        Time since the start of the interval; the rounded time stays within the interval.
    start_us, length_us
        As in `Interval`.
    polarity_and_position
        The low 33 bits.

    Returns
    -------
    uint64
    """
    t_us = np.int64(math.floor(start_us + since_us + 0.5))
    return (np.uint64(min(max(t_us, 0), length_us)) << TIME_SHIFT) | polarity_and_position


@jit
def count_times(pool, segment, s, f, counts):
    """Count the events of one setting, interval and band at each microsecond of the interval.

    Parameters
    ----------
    pool, segment, s, f
        As in `gather`.
    counts
        (interval_us + 1,) updated.
    """
    for block in range(segment.shape[0]):
        for j in range(segment[block, s, f, START], segment[block, s, f, STOP]):
            counts[pool[j] >> TIME_SHIFT] += np.uint64(1)


@jit
def spread(pool, segment, s, f, next_place, words):
    """Put the events of one setting, interval and band in order of time; keep raster order.

    Parameters
    ----------
    pool, segment, s, f
        As in `gather`.
    next_place
        Place in `words` of the next event at each microsecond of the interval; updated.
    words
        Output, uint32: polarity, 15 bits of the row, 16 bits of the column.
    """
    for block in range(segment.shape[0]):
        for j in range(segment[block, s, f, START], segment[block, s, f, STOP]):
            word = pool[j]
            time = word >> TIME_SHIFT
            words[next_place[time]] = np.uint32(
                (word & np.uint64(0x7FFFFFFF)) | ((word >> np.uint64(1)) & np.uint64(0x80000000))
            )
            next_place[time] += np.uint64(1)


@jit
def unpack(words, stops, start_us, columns):
    """Unpack the words of `spread`.

    Parameters
    ----------
    words
        (N,) all events of one interval.
    stops
        End of the events of each microsecond of the interval.
    start_us
        Start of the interval, whole microseconds.
    columns
        `Columns` of N events, output.
    """
    t_us, x, y, p = columns
    begin = np.uint64(0)
    for time in range(stops.size):
        for k in range(begin, stops[time]):
            t_us[k] = start_us + np.int64(time)
        begin = stops[time]
    for k in range(words.size):
        word = words[k]
        x[k] = word & np.uint32(0xFFFF)
        y[k] = (word >> np.uint32(16)) & ROW_MASK
        p[k] = np.int8(np.int32(word >> np.uint32(31)) * 2 - 1)


@jit
def gather(pool, segment, s, f, words, used):
    """Append the events of one setting, interval and band to `words`, in raster order.

    Parameters
    ----------
    pool, segment
        The events of the band, and the ranges (blocks, S, F, 2) that hold them.
    s, f
        Setting and interval.
    words, used
        Output, and its used size.

    Returns
    -------
    int
        New used size of `words`.
    """
    for block in range(segment.shape[0]):
        for j in range(segment[block, s, f, START], segment[block, s, f, STOP]):
            words[used] = pool[j]
            used += 1
    return used


@allocating
def sort_by_time(words, other, interval_us, start_us, columns):
    """Sort packed events by time, keep raster order within a microsecond, and unpack them.

    The method is a stable radix sort with digits of at most 12 bits.

    Parameters
    ----------
    words, other
        (N,) packed events of one interval, and scratch memory of the same size; overwritten.
    interval_us, start_us
        Length and start of the interval, whole microseconds.
    columns
        `Columns` of N events, output.
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
