"""CUDA kernels: light on the pixels, events in raster order, and events in order of time.

`advance` runs twice over the same frames: it counts the events of each pixel and interval first, so
that each has its place, in raster order, when it is written. The sort is a stable radix sort by
time, so events of one microsecond stay in raster order.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from threading import Lock
from typing import Any

import numpy as np
from numba import cuda

from sensor.kernels.elementary import log
from sensor.kernels.noise import NoiseSource
from sensor.kernels.packing import COORDINATE_MASK, POLARITY_SHIFT, ROW_SHIFT, TIME_SHIFT
from sensor.kernels.photoreceptor import Step
from sensor.kernels.pixel import (
    Comparator,
    Filter,
    Out,
    Span,
    advance_filtered,
    fire_line,
    fire_noise,
)
from sensor.kernels.radiance import MIN_LIGHT

THREADS = 256  # of a block
SCAN_THREADS = 1024
DIGIT_BITS = 4
DIGITS = 1 << DIGIT_BITS
_WORDS = 8  # of a thread that sorts
SORT_TILE = THREADS * _WORDS

_WARNS = Lock()  # filters of warnings are those of all threads
_COUNTS = DIGITS * THREADS  # of a block that sorts
_PADDED = SORT_TILE + THREADS


def launch(kernel: Any, blocks: Any, *arguments: object, threads: Any = THREADS) -> None:
    """Run a kernel."""
    with _WARNS, warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*Grid size .* low occupancy")  # of small sensors
        configured = kernel[blocks, threads]
    configured(*arguments)


@cuda.jit
def integrate_area(frames, first_y, samples_y, weight_y, first_x, samples_x, weight_x, out):
    """Average the radiance over the area of each pixel, Eq. (3), in the order of the CPU's kernel.

    (F, H, W) linear radiance in, (F, height, width) out, by the `Overlap` of rows and of columns.
    The mean of invalid radiance is NaN.
    """
    x, y, f = cuda.grid(3)
    if x < out.shape[2] and y < out.shape[1]:
        total = 0.0
        for j in range(samples_x[x]):
            column, line = first_x[x] + j, 0.0
            for i in range(samples_y[y]):
                value = np.float64(frames[f, first_y[y] + i, column])
                if not (value >= 0.0 and value < np.inf):
                    value = np.nan  # for `advance`, which checks the mean
                line += weight_y[y, i] * value
            total += weight_x[x, j] * line
        out[f, y, x] = total


@cuda.jit(device=True)
def _sum_before(values, t, threads):
    """Replace each of a block's values by the sum up to it; return the sum before this thread's."""
    own = values[t]
    cuda.syncthreads()
    step = 1
    while step < threads:
        before = values[t - step] if t >= step else 0
        cuda.syncthreads()
        values[t] += before
        cuda.syncthreads()
        step *= 2
    return values[t] - own


@functools.cache
def advance(filtered: bool, noisy: bool) -> Callable[..., Any]:
    """Return the kernel that advances all pixels of a setting through some frame intervals."""

    @cuda.jit
    def kernel(
        light, dark, width, u, v1, v2, memory, C_on, C_off, hot_hz, clock, start_us,
        poles, light_a, light_0, noise_hz, noise_exponent, log_dark, seed, first_frame,
        upto, base, first, words, writes, bad,
    ):  # fmt: skip
        """Count the events, or write them and update the state.

        `light` is (F, P) linear radiance at the ends of the intervals, `dark` I_dark; `bad`, (1,),
        is set to 1 if radiance is negative, not finite, or below `MIN_LIGHT` with I_dark. The state
        is (P,), v1 and v2 of any size without a filter. Thresholds are (P,) or (1,), `hot_hz` (P,)
        or (0,). `clock` is (F, 12), each interval's `Span` and `Step`; `start_us` is the start of
        the words' clock on the spans' clock. The noise is as in `fire_noise`, the rest as in
        `Settings`.

        The count gives `upto`, (F, P) int32, events of each pixel and of the pixels before it in
        its block, and `base`, (F, blocks) int64, events of each block and interval. To write,
        `base` has the events of all blocks before it, `first` is the number of events before
        `words`, (N,) packed events.
        """
        shared = cuda.shared.array(THREADS, np.int32)
        t, block = cuda.threadIdx.x, cuda.blockIdx.x
        i = block * THREADS + t
        active = i < memory.size
        u0 = u1 = level = on = off = a = b = 0.0
        place = 0
        if active:
            u0, level = u[i], memory[i]
            on, off = C_on[i % C_on.size], C_off[i % C_off.size]
            place = (i // width) << 16 | i % width
            if filtered:
                a, b = v1[i], v2[i]
        for f in range(light.shape[0]):
            count, at, fires = 0, 0, True
            if active:
                if writes:
                    stop = upto[f, i]
                    count = stop - (upto[f, i - 1] if t > 0 else 0)
                    at, fires = base[f, block] - first + stop - count, count > 0
                # An ideal pixel needs the logarithm of its light only where it fires.
                if filtered or fires:
                    if not filtered and writes and f > 0:
                        u0 = log(np.float64(light[f - 1, i]) + dark)
                    radiance = np.float64(light[f, i])
                    valid = radiance >= 0.0 and radiance < np.inf
                    if not (valid and radiance + dark >= MIN_LIGHT):
                        bad[0] = 1
                        radiance = 1.0
                    u1 = log(radiance + dark)
                    span = Span(
                        clock[f, 0], clock[f, 1], clock[f, 2], np.int64(clock[f, 3]),
                        np.int64(clock[f, 4]) - start_us,
                    )  # fmt: skip
                    out = Out(place, words, at, writes)
                    comparator = Comparator(level, on, off)
                    if filtered:
                        step = Step(
                            clock[f, 5], clock[f, 6], clock[f, 7], clock[f, 8],
                            clock[f, 9], clock[f, 10], clock[f, 11],
                        )  # fmt: skip
                        which = Filter(poles, light_a, light_0)
                        a, b, level, count = advance_filtered(
                            u0, u1, a, b, which, step, fires, comparator, span, out
                        )
                    else:
                        level, count = fire_line(u0, u1, comparator, span, out)
                    if noisy and fires:
                        source = NoiseSource(noise_hz, noise_exponent, dark, hot_hz, seed, 0)
                        count = fire_noise(
                            source, log_dark, u0, u1, i, first_frame + f, span, out, count
                        )
                    u0 = u1
                level -= clock[f, 1]
            if not writes:
                shared[t] = count
                stop = _sum_before(shared, t, THREADS) + count
                if active:
                    upto[f, i] = stop
                if t == THREADS - 1:
                    base[f, block] = stop
                cuda.syncthreads()
        if active and writes:
            u[i], memory[i] = log(np.float64(light[light.shape[0] - 1, i]) + dark), level
            if filtered:
                v1[i], v2[i] = a, b

    return kernel


@cuda.jit
def sums_before(values, starts):
    """Replace (R, N) int64 by the sums of the values before; one block of SCAN_THREADS threads.

    `starts`, (R + 1,) int64, gets the new first value of each row, and the sum of all.
    """
    shared = cuda.shared.array(SCAN_THREADS, np.int64)
    t, rows, columns = cuda.threadIdx.x, values.shape[0], values.shape[1]
    length = (rows * columns + SCAN_THREADS - 1) // SCAN_THREADS
    first_row, first_column = t * length // columns, t * length % columns
    count = min(length, rows * columns - t * length)
    own, row, column = 0, first_row, first_column
    for _ in range(count):
        own += values[row, column]
        column += 1
        if column == columns:
            row, column = row + 1, 0
    shared[t] = own
    running = _sum_before(shared, t, SCAN_THREADS)
    if t == SCAN_THREADS - 1:
        starts[rows] = running + own
    row, column = first_row, first_column
    for _ in range(count):
        value = values[row, column]
        values[row, column] = running
        if column == 0:
            starts[row] = running
        running += value
        column += 1
        if column == columns:
            row, column = row + 1, 0


@cuda.jit(device=True)
def _part_sum(values, part, length):
    """Return the sum of one of the equal parts of a block's values."""
    total = 0
    for k in range(part * length, (part + 1) * length):
        total += values[k]
    return total


@cuda.jit
def count_digits(words, shift, counts):
    """Count the words of each tile by one digit of their time, from bit `shift`.

    `words` are (N,) packed events, `counts` (digits, tiles) int64.
    """
    own = cuda.shared.array(_COUNTS, np.int16)  # a column for each thread
    parts = cuda.shared.array(THREADS, np.int32)
    t, tile = cuda.threadIdx.x, cuda.blockIdx.x
    for digit in range(DIGITS):
        own[digit * THREADS + t] = 0
    for j in range(_WORDS):
        k = tile * SORT_TILE + j * THREADS + t
        if k < words.size:
            own[((words[k] >> shift) & np.uint64(DIGITS - 1)) * THREADS + t] += 1
    cuda.syncthreads()
    parts[t] = _part_sum(own, t, DIGITS)
    cuda.syncthreads()
    if t < DIGITS:
        counts[t, tile] = _part_sum(parts, t, THREADS // DIGITS)


@cuda.jit
def move_by_digit(words, shift, starts, out):
    """Move words to their places by one digit, without changing the order of equal digits.

    Each block sorts its tile in its own memory first, so that neighbors write to neighbors.
    `starts` is (digits, tiles), the place of the first word of each digit and tile.
    """
    tile_in = cuda.shared.array(_PADDED, np.uint64)  # a word is left out after those of a thread
    tile_out = cuda.shared.array(SORT_TILE, np.uint64)
    own = cuda.shared.array(_COUNTS, np.int16)
    parts = cuda.shared.array(THREADS, np.int32)
    first = cuda.shared.array(DIGITS, np.int32)
    t, tile = cuda.threadIdx.x, cuda.blockIdx.x
    size = min(SORT_TILE, words.size - tile * SORT_TILE)
    for j in range(_WORDS):
        k = j * THREADS + t
        if k < size:
            tile_in[k + k // _WORDS] = words[tile * SORT_TILE + k]
    for digit in range(DIGITS):
        own[digit * THREADS + t] = 0
    cuda.syncthreads()
    mine = max(0, min(_WORDS, size - t * _WORDS))
    for k in range(t * (_WORDS + 1), t * (_WORDS + 1) + mine):
        own[((tile_in[k] >> shift) & np.uint64(DIGITS - 1)) * THREADS + t] += 1
    cuda.syncthreads()
    parts[t] = _part_sum(own, t, DIGITS)
    running = _sum_before(parts, t, THREADS)
    for k in range(t * DIGITS, (t + 1) * DIGITS):
        count = own[k]
        own[k] = running
        running += count
    cuda.syncthreads()
    if t < DIGITS:
        first[t] = own[t * THREADS]
    cuda.syncthreads()
    for k in range(t * (_WORDS + 1), t * (_WORDS + 1) + mine):
        word = tile_in[k]
        place = ((word >> shift) & np.uint64(DIGITS - 1)) * THREADS + t
        tile_out[own[place]] = word
        own[place] += 1
    cuda.syncthreads()
    for j in range(_WORDS):
        k = j * THREADS + t
        if k < size:
            word = tile_out[k]
            digit = np.int64((word >> shift) & np.uint64(DIGITS - 1))
            out[starts[digit, tile] + k - first[digit]] = word


@cuda.jit
def unpack(words, start_us, t_us, x, y, p):
    """Unpack (N,) events, whose clock starts at `start_us`."""
    k = cuda.grid(1)
    if k < words.size:
        word = words[k]
        t_us[k] = start_us + np.int64(word >> TIME_SHIFT)
        x[k] = np.uint16(word & COORDINATE_MASK)
        y[k] = np.uint16((word >> ROW_SHIFT) & COORDINATE_MASK)
        p[k] = np.int8(np.int64((word >> POLARITY_SHIFT) & np.uint64(1)) * 2 - 1)
