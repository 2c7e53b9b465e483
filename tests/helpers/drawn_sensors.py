"""Drawn sensors, frames and times: any frame interval, cutoff, leak and clock."""

import math

import numpy as np

from exact_sensor import Pixel
from sensor import SensorModel

PIXELS = 20  # of a drawn sensor; they share its electronics and times, not their light
TOO_NEAR = 1e-12  # log units
KINDS = ("any", "video", "still", "leak", "half microseconds", "since 1970", "own light")


def walk(rng, frames, roughness):
    """Draw log intensities of any range, (frames, PIXELS)."""
    return np.cumsum(rng.normal(0, roughness, (frames, PIXELS)), axis=0)


def drawn_times(rng, kind):
    """Return (frame times in seconds, cutoff in Hz) of one kind of recording."""
    if kind == "video":  # 24 to 240 frames a second, cutoffs from night to full sun
        return np.arange(6) / rng.uniform(24, 240), 10 ** rng.uniform(0, 4)
    interval_s = 10 ** rng.uniform(-5, 0.5)
    x = 10 ** rng.uniform(-9, 6)
    if kind == "half microseconds":
        interval_s = round(interval_s * 1e6 + 1) * 1e-6
        return np.arange(6) * interval_s + 0.5e-6, 200.0 if rng.random() < 0.5 else math.inf
    intervals = interval_s * rng.uniform(0.3, 1.7, 5)
    if kind == "still":  # a step, however short, then nothing
        intervals[0] = 10 ** rng.uniform(-9, -3)
    return np.concatenate(([0.0], np.cumsum(intervals))), x / interval_s / (2 * math.pi)


def drawn(seed):
    """Return one sensor, its frames and times, from a seed alone: (kind, radiance, t_s, Pixel)."""
    rng = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    t_s, cutoff_hz = drawn_times(rng, kind)
    if rng.random() < 0.15 and kind != "own light":
        cutoff_hz = math.inf
    C = float(rng.choice([0.05, 0.2, 0.5]))
    u = walk(rng, len(t_s), C * 10 ** rng.uniform(-1, 0.8))
    interval_s = float(np.median(np.diff(t_s)))
    leak_hz = 0.0
    if kind == "still":
        u[1:] = u[1]
    if kind == "video":  # a bar over a still background
        held = rng.random(u.shape) < 0.5
        for k in range(1, len(u)):
            u[k] = np.where(held[k], u[k - 1], u[k])
    if kind in ("leak", "half microseconds") or rng.random() < 0.2:
        leak_hz = rng.uniform(0.1, 4) / interval_s
    if kind in ("leak", "half microseconds") and rng.random() < 0.7:
        # A period that divides the interval, or is divided by it: levels fall on frame times, but
        # not on the last one, where it is uncertain whether the event still comes.
        n = int(rng.integers(1, 5))
        t_s = np.arange(len(t_s)) * interval_s + (t_s[0] if kind != "leak" else 0.0)
        t_s[-1] += 0.37 * interval_s
        leak_hz = float(rng.choice([n / interval_s, 1 / (n * interval_s)]))
        if rng.random() < 0.5:
            u[:] = u[0]
    if kind == "since 1970" or rng.random() < 0.1:
        t_s = t_s + float(rng.choice([1.6e9, -3e3, 4.6e9, 10 ** rng.uniform(3, 12)]))
        t_s = t_s[np.concatenate(([True], np.diff(t_s) > 0))]
        u = u[: len(t_s)]
    pixel = Pixel(C=C, cutoff_hz=cutoff_hz, poles=int(rng.integers(1, 3)), leak_hz=leak_hz)
    if kind == "own light":
        reference = float(10 ** rng.uniform(-3, 3))
        pixel = Pixel(C, cutoff_hz, pixel.poles, leak_hz, 0.01, reference)
    return kind, np.exp(u), t_s, pixel


def row_of(pixel):
    """Return the model of a row of PIXELS such pixels."""
    return SensorModel(
        width=PIXELS,
        height=1,
        contrast_threshold=pixel.C,
        cutoff_hz=pixel.cutoff_hz,
        photoreceptor="two_pole" if pixel.poles == 2 else "one_pole",
        leak_hz=pixel.leak_hz,
        dark_level=pixel.dark,
        cutoff_reference=pixel.cutoff_reference,
    )


def is_too_near(exact):
    """Return whether a voltage is within TOO_NEAR of a level, or takes 1 us for that distance."""
    return min(exact.margin, TOO_NEAR / max(exact.worst_slowness_us, 1e-300)) < TOO_NEAR
