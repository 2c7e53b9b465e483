"""A moving texture for sensors."""

import math

import numpy as np


def texture_in_motion(seed, frames, size, interval_s, travel_px=8.0):
    """Return a periodic 1/f texture that moves steadily by travel_px: (T, H, W) radiance, and
    times."""
    rng = np.random.default_rng(seed)
    height, width = size
    fy, fx = np.fft.fftfreq(2 * height)[:, None], np.fft.rfftfreq(2 * width)[None]
    radius = np.hypot(fy, fx)
    radius[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((2 * height, 2 * width))) / radius
    angle = rng.uniform(0, 2 * math.pi)
    t_s = np.arange(frames) * interval_s * (1 + 0.2 * rng.random())
    way = travel_px * t_s[:, None, None] / t_s[-1]
    down, right = (
        np.exp(-2j * np.pi * way * f) for f in (fy * math.sin(angle), fx * math.cos(angle))
    )
    views = np.fft.irfft2(spectrum * down * right)
    views *= 0.7 / views.std()
    return np.exp(views[:, :height, :width]).astype(np.float32), t_s
