"""Noise events of a pixel, from random numbers that depend on their indices alone."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import jit
from sensor.kernels.packing import FULL, PLACE_MASK, POLARITY_SHIFT, pack


@jit
def random_bits(seed, pixel, frame, draw):
    """64 random bits that depend on nothing but their four indices (SplitMix64, chained)."""
    bits = np.uint64(seed)
    for index in (np.uint64(pixel), np.uint64(frame), np.uint64(draw)):
        bits = (bits ^ index) + np.uint64(0x9E3779B97F4A7C15)
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        bits = bits ^ (bits >> np.uint64(31))
    return bits


@jit
def uniform(seed, pixel, frame, draw):
    """A random number in [0, 1)."""
    return np.float64(random_bits(seed, pixel, frame, draw) >> np.uint64(11)) * 2.0**-53


# Mean of a Poisson process that is drawn at once, and room for the draws of its events.
MOST_NOISE = 64.0
DRAWS_SHIFT = 20


@jit
def poisson(mean, left):
    """Number of events of a Poisson process by inversion: mean at most MOST_NOISE, left in [0, 1).

    `left` is what remains of the cumulated probability; rounding may leave 1e-16 of it.
    """
    if left < 1.0 - mean:  # exp(-mean) is not less: as a rule, nothing happens
        return 0
    probability = math.exp(-mean)
    count = 0
    while left >= probability and (count < mean or probability > 1e-18):
        left -= probability
        count += 1
        probability *= mean / count
    return count


class NoiseSource(NamedTuple):
    """What decides on the noise of a block's pixels."""

    dark_hz: float  # rate in the dark
    exponent: float  # of its fall with the light
    dark: float  # I_dark
    hot_hz: NDArray[np.float64]  # each hot pixel's own rate, or empty
    seed: np.uint64
    first_pixel: int  # number of the block's first pixel


@jit
def noise_events(source, u0, frame, interval, work, begin, used):
    """Add a Poisson process of events of either polarity to pixels over one interval.

    The rate is dark_hz ((I + I_dark) / I_dark)^-exponent at the interval's start, and a hot pixel's
    own. The interval's events so far, from `begin`, and these are merged in raster order. Returns
    how much of the pool is used, or FULL.
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
        # Parts of the interval are Poisson processes of their own, each of a mean that exp holds.
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
    signal = pool[begin:signal_end].copy()
    noise = pool[signal_end:used].copy()
    j, k = 0, 0
    for out in range(begin, used):
        take_signal = k == noise.size or (
            j < signal.size and (signal[j] & PLACE_MASK) <= (noise[k] & PLACE_MASK)
        )
        if take_signal:
            pool[out] = signal[j]
            j += 1
        else:
            pool[out] = noise[k]
            k += 1
    return used
