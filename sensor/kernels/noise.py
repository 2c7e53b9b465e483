"""Noise events, from random numbers that depend only on seed, pixel, frame and draw."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import inlined, jit
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
MAX_NOISE = 64.0
DRAWS_SHIFT = 20
HOT_DRAWS = 1 << 62  # first draw of hot pixels

_SMALL_SLOPE = 0.05  # the next term of its series is less than 1e-11


@jit
def poisson(mean, left):
    """Draw the number of events of a Poisson process, by inversion.

    Parameters
    ----------
    mean
        At most MAX_NOISE.
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


class Rate(NamedTuple):
    """An exponential course of a rate over an interval, by its mean number of events."""

    mean: float
    slope: float  # |logarithm of the ratio of the rates at both ends|
    rises: bool


@inlined
def shot_noise_rate(source, log_dark, u0, u1, dt_s):
    """Return the rate of shot noise over an interval.

    The rate is dark_hz ((I + I_dark) / I_dark)^-exponent. The log intensity is linear in time, so
    the rate is exponential, and its mean is the larger end's times (1 - e^-slope) / slope.

    Parameters
    ----------
    source
        `NoiseSource`.
    log_dark
        Logarithm of I_dark.
    u0, u1
        Log intensity at both ends of the interval.
    dt_s
        Length of the interval.

    Returns
    -------
    Rate
    """
    slope = source.exponent * abs(u1 - u0)
    if slope < _SMALL_SLOPE:
        share = 1.0 - slope * (1.0 / 6.0)  # from the last of six terms inwards
        for term in (5.0, 4.0, 3.0, 2.0):
            share = 1.0 - slope / term * share
    else:
        share = -math.expm1(-slope) / slope
    largest_hz = source.dark_hz * math.exp(-source.exponent * (min(u0, u1) - log_dark))
    return Rate(largest_hz * share * dt_s, slope, u1 < u0)


@inlined
def time_in_interval(share, rate):
    """Return the time before which a share of the events comes on average, as a part of 1.

    Parameters
    ----------
    share
        In [0, 1).
    rate
        `Rate`.
    """
    if rate.slope == 0.0:
        return share
    if rate.rises:  # backwards in time it falls
        return max(1.0 + math.log1p((1.0 - share) * math.expm1(-rate.slope)) / rate.slope, 0.0)
    return -math.log1p(share * math.expm1(-rate.slope)) / rate.slope


@inlined
def add_poisson(rate, seed, pixel, frame, first_draw, position, interval, pool, used):
    """Append the events of a Poisson process of one pixel over one interval, of random polarity.

    Parameters
    ----------
    rate
        `Rate`.
    seed, pixel, frame, first_draw
        Indices of the first random number.
    position
        Packed row and column of the pixel.
    interval, pool, used
        Clock, packed events, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    start_us, length_us = interval.start_us, interval.length_us
    # Parts of equal mean, at most MAX_NOISE.
    parts = np.int64(rate.mean * (1.0 / MAX_NOISE)) + 1
    for part in range(parts):
        draw = first_draw + (part << DRAWS_SHIFT)
        count = poisson(rate.mean / parts, uniform(seed, pixel, frame, draw))
        for k in range(count):
            if used == pool.size:
                return FULL
            share = (part + uniform(seed, pixel, frame, draw + 2 * k + 1)) / parts
            bit = random_bits(seed, pixel, frame, draw + 2 * k + 2) & np.uint64(1)
            since_us = interval.dt_s * 1e6 * time_in_interval(share, rate)
            pool[used] = pack(since_us, start_us, length_us, (bit << POLARITY_SHIFT) | position)
            used += 1
    return used


@jit
def noise_events(source, u0, u1, frame, interval, work, begin, used):
    """Add Poisson noise of both polarities to the events of a block over one interval.

    The events stay in raster order.

    Parameters
    ----------
    source
        `NoiseSource`.
    u0, u1
        (block,) log intensity at the start and the end of the interval.
    frame, interval
        Index of the interval since the first frame, and its clock.
    work, begin, used
        Memory, and the range of the pool with the events of the interval so far.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    log_dark = math.log(source.dark)
    pool, position = work.pool, work.position
    signal_end = used
    for i in range(u0.size):
        pixel = source.first_pixel + i
        if source.dark_hz > 0.0:
            rate = shot_noise_rate(source, log_dark, u0[i], u1[i], interval.dt_s)
            used = add_poisson(
                rate, source.seed, pixel, frame, 0, position[i], interval, pool, used
            )
        if source.hot_hz.size > 0 and source.hot_hz[i] > 0.0 and used >= 0:
            rate = Rate(source.hot_hz[i] * interval.dt_s, 0.0, False)
            used = add_poisson(
                rate, source.seed, pixel, frame, HOT_DRAWS, position[i], interval, pool, used
            )
        if used < 0:
            return FULL
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
