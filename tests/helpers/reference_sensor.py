"""A slow sensor: one pixel at a time in plain Python float64. The oracle for every kernel.

It shares no code with the package, and finds crossings in another way: it divides each frame
interval finely to bracket every turn, and every crossing between turns, for Brent's method.
"""

import math
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

CUTS = 200


def area_mean(frame, height, width):
    """Return the exact box filter by brute force: repeat each sample until both grids divide it."""
    H, W = frame.shape
    fine = np.repeat(np.repeat(frame.astype(np.float64), height, axis=0), width, axis=1)
    return fine.reshape(height, H, width, W).mean(axis=(1, 3))


def voltage(u0, u1, v1, v2, dt, cutoff_hz, poles=2):
    """Return v1(t) and v2(t) of two poles at a, for the input u0 + s t; with one pole v2 equals
    v1."""
    s = (u1 - u0) / dt
    if math.isinf(cutoff_hz):
        return (lambda t: u0 + s * t), (lambda t: u0 + s * t)
    a = 2 * math.pi * cutoff_hz
    A = v1 - u0 + s / a
    B = v2 - u0 + 2 * s / a
    if poles == 1:
        A = v2 - u0 + s / a
        return (lambda t: u0 + s * t), (lambda t: u0 + s * t - s / a + A * math.exp(-a * t))
    return (
        lambda t: u0 + s * t - s / a + A * math.exp(-a * t),
        lambda t: u0 + s * t - 2 * s / a + (B + A * a * t) * math.exp(-a * t),
    )


def v2e_cutoff_hz(light, white, cutoff_hz):
    """Return v2e's cutoff for a light as its authors compute it: from 8-bit gray values plus 20."""
    return cutoff_hz * (255 * light / white + 20) / 275


def pixel_events(u, t_s, C, cutoff_hz, poles=2, leak_hz=0.0):
    """Return events [(t seconds, polarity)] of one pixel with log intensities u at times t_s.

    `cutoff_hz` is a number, or one for each interval.

    The memory leaks C leak_hz per second, which looks like a rise of the voltage.
    """
    v1 = v2 = memory = u[0]
    leak = C * leak_hz
    events = []
    cutoffs_hz = np.broadcast_to(cutoff_hz, len(u) - 1).tolist()
    for (u0, u1), (t0, t1), cutoff in zip(pairwise(u), pairwise(t_s), cutoffs_hz, strict=True):
        dt = t1 - t0
        pole_1, pole_2 = voltage(u0, u1, v1, v2, dt, cutoff, poles)

        def seen(t):
            return pole_2(t) + leak * t  # noqa: B023

        def slope(t):
            return a * (pole_1(t) - pole_2(t)) + leak  # noqa: B023

        a = 2 * math.pi * cutoff
        turns = []
        if math.isfinite(cutoff):
            fine = [(t, slope(t)) for t in np.linspace(0, dt, CUTS + 1).tolist()]
            for (t_a, slope_a), (t_b, slope_b) in pairwise(fine):
                if slope_a * slope_b < 0:
                    turns.append(brentq(slope, t_a, t_b, xtol=1e-15))
        for (t_a, low), (t_b, high) in pairwise([(t, seen(t)) for t in [0.0, *turns, dt]]):
            while abs(high - memory) >= C:
                polarity = 1 if high > memory else -1
                level = memory + polarity * C
                if (low - level) * (high - level) > 0:  # rounding left it a hair before t_a
                    t = t_a
                else:
                    t = brentq(lambda t: seen(t) - level, t_a, t_b, xtol=1e-15)  # noqa: B023
                events.append((t0 + t, polarity))
                memory = level
        memory -= leak * dt
        v1, v2 = pole_1(dt), pole_2(dt)
    return events


def simulate(radiance, t_s, model, dark_level):
    """Return events as columns (t_us, x, y, p) in the documented order."""
    frames = [np.log(area_mean(f, model.height, model.width) + dark_level) for f in radiance]
    u = np.stack(frames)
    found = [
        (math.floor(t * 1e6 + 0.5), y, x, k, p)
        for y in range(model.height)
        for x in range(model.width)
        for k, (t, p) in enumerate(
            pixel_events(
                u[:, y, x].tolist(),
                t_s,
                model.contrast_threshold,
                model.cutoff_hz,
                model.poles,
                model.leak_hz,
            )
        )
    ]
    found.sort()
    t, y, x, _, p = (
        (np.array(c, dtype=np.int64) for c in zip(*found, strict=True))
        if found
        else (np.empty((5, 0), np.int64))
    )
    return t, x, y, p
