"""Noise events, from random numbers that depend only on seed, pixel, frame and draw."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import jit
from sensor.kernels.packing import FULL, PLACE_MASK, POLARITY_SHIFT, pack


@jit
def random_bits(seed, pixel, frame, draw):
    """Return 64 random bits (SplitMix64, chained over the indices).

    Parameters
    ----------
    seed, pixel, frame, draw
        The four indices that the bits depend on.
    """
    bits = np.uint64(seed)
    for index in (np.uint64(pixel), np.uint64(frame), np.uint64(draw)):
        bits = (bits ^ index) + np.uint64(0x9E3779B97F4A7C15)
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        bits = bits ^ (bits >> np.uint64(31))
    return bits


@jit
def uniform(seed, pixel, frame, draw):
    """Return a random number in [0, 1).

    Parameters
    ----------
    seed, pixel, frame, draw
        As in `random_bits`.
    """
    return np.float64(random_bits(seed, pixel, frame, draw) >> np.uint64(11)) * 2.0**-53


# Largest mean of one Poisson draw, and bits for the draws of its events.
MOST_NOISE = 64.0
DRAWS_SHIFT = 20


@jit
def poisson(mean, left):
    """Draw the number of events of a Poisson process, by inversion.

    Parameters
    ----------
    mean
        At most MOST_NOISE.
    left
        Random number in [0, 1), from which the cumulative probability is subtracted.

    Returns
    -------
    int
    """
    if left < 1.0 - mean:  # exp(-mean) is at least this: the usual case
        return 0
    probability = math.exp(-mean)
    count = 0
    while left >= probability and (count < mean or probability > 1e-18):
        left -= probability
        count += 1
        probability *= mean / count
    return count


class NoiseSource(NamedTuple):
    """Parameters of the noise of a block."""

    dark_hz: float  # rate in the dark
    exponent: float  # of the decrease of the rate with light
    dark: float  # I_dark
    hot_hz: NDArray[np.float64]  # (block,) additional rate of hot pixels, or empty
    seed: np.uint64
    first_pixel: int  # index of the block's first pixel


@jit
def noise_events(source, u0, frame, interval, work, begin, used):
    """Add Poisson noise of both polarities to the events of a block over one interval.

    The rate is dark_hz ((I + I_dark) / I_dark)^-exponent at the start of the interval, plus hot_hz.
    The events stay in raster order.

    Parameters
    ----------
    source
        `NoiseSource`.
    u0
        (block,) log intensity at the start of the interval.
    frame, interval
        Index of the interval since the first frame, and its clock.
    work, begin, used
        Memory, and the range of the pool with the events of the interval so far.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    dark_hz, exponent, dark, hot_hz, seed, first_pixel = source
    log_dark = math.log(dark)
    pool, position = work.pool, work.position
    dt_s, start_us, length_us = interval.dt_s, interval.start_us, interval.length_us
    signal_end = used
    for i in range(u0.size):
        rate_hz = hot_hz[i] if hot_hz.size > 0 else 0.0
        if dark_hz > 0.0:
            rate_hz += dark_hz * math.exp(-exponent * (u0[i] - log_dark))
        mean = rate_hz * dt_s
        # Split the interval, so that the mean of each part is at most MOST_NOISE.
        parts = np.int64(mean * (1.0 / MOST_NOISE)) + 1
        part_us = dt_s * 1e6 / parts
        for part in range(parts):
            draw = part << DRAWS_SHIFT
            count = poisson(mean / parts, uniform(seed, first_pixel + i, frame, draw))
            for k in range(count):
                if used == pool.size:
                    return FULL
                share = uniform(seed, first_pixel + i, frame, draw + 2 * k + 1)
                bit = random_bits(seed, first_pixel + i, frame, draw + 2 * k + 2) & np.uint64(1)
                word = (bit << POLARITY_SHIFT) | position[i]
                pool[used] = pack(part_us * (part + share), start_us, length_us, word)
                used += 1
    # Merge both from the end, with the noise in the free part of the pool.
    count = used - signal_end
    if used + count > pool.size:
        return FULL
    for k in range(signal_end, used):
        pool[k + count] = pool[k]
    signal, noise = signal_end - 1, used + count - 1
    for out in range(used - 1, begin - 1, -1):
        if noise < used or (
            signal >= begin and (pool[signal] & PLACE_MASK) > (pool[noise] & PLACE_MASK)
        ):
            pool[out] = pool[signal]
            signal -= 1
        else:
            pool[out] = pool[noise]
            noise -= 1
    return used
