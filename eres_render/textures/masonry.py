"""Walls: plaster, wallpaper, bricks."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise


def plaster(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.7
) -> Float32:
    """Return rough plaster: trowel marks, grains and their small shadows."""
    import cv2

    relief = fractal_noise(shape, 0.02 / texel_m, 1, rng)
    slope = relief - cv2.blur(relief, (3, 3))
    stain = fractal_noise(shape, 1.0 / texel_m, 0.05 / texel_m, rng)
    grain = rng.standard_normal(shape, dtype=np.float32)
    return np.exp(np.log(tone) + 0.10 * slope + 0.035 * stain + 0.05 * grain, dtype=np.float32)


def wallpaper(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.5
) -> Float32:
    """Return a printed paper: palmettes on stripes, half a repeat apart, on embossed paper."""
    y, x = (np.arange(n, dtype=np.float32) * np.float32(texel_m) for n in shape)
    period_x, period_y = 0.18, 0.27
    x, y = x[None, :], y[:, None]
    column = np.floor(x / period_x)
    u = x - (column + 0.5) * period_x
    v = (y + 0.5 * period_y * (column % 2)) % period_y - 0.5 * period_y
    log_tone = np.log(tone) + 0.10 * np.sign(np.sin(2 * np.pi * x / (period_x / 6)))
    angle, radius = np.arctan2(u, -v + 0.02), np.hypot(u, v - 0.02)
    petals = 0.075 * np.abs(np.cos(3.5 * angle)) ** 0.6 * np.cos(0.45 * angle)
    log_tone = np.where(radius < petals, np.log(0.45 * tone), log_tone)
    log_tone = np.where(radius < 0.75 * petals, np.log(1.25 * tone), log_tone)
    log_tone = np.where(radius < 0.40 * petals, np.log(0.35 * tone), log_tone)
    stem = (np.abs(u - 0.012 * np.sin(2 * np.pi * v / period_y)) < 0.004) & (v > 0)
    log_tone = np.where(stem, np.log(0.5 * tone), log_tone)
    berry = np.hypot(np.abs(u) - 0.045, v - 0.085) < 0.012
    log_tone = np.where(berry, np.log(0.4 * tone), log_tone)
    log_tone = log_tone + 0.05 * rng.standard_normal(shape, dtype=np.float32)
    log_tone += 0.04 * fractal_noise(shape, 1.0 / texel_m, 0.01 / texel_m, rng)
    return np.exp(log_tone, dtype=np.float32)


def bricks(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.28
) -> Float32:
    """Return a wall of bricks in running bond, no two alike, in sandy mortar."""
    length_m, height_m, joint_m = 0.25, 0.075, 0.012
    warp = fractal_noise(shape, 0.03 / texel_m, 0.004 / texel_m, rng)
    y = np.arange(shape[0], dtype=np.float32)[:, None] * np.float32(texel_m) + 0.0012 * warp
    x = np.arange(shape[1], dtype=np.float32) * np.float32(texel_m) + 0.0012 * warp
    course = np.floor(y / height_m).astype(np.intp)
    x = x + 0.5 * length_m * (course % 2)
    brick = np.floor(x / length_m).astype(np.intp)
    shade = rng.standard_normal((course.max() + 2, brick.max() + 2), dtype=np.float32)
    edge = np.minimum(
        np.minimum(x - brick * length_m, (brick + 1) * length_m - x),
        np.minimum(y - course * height_m, (course + 1) * height_m - y),
    )
    rough = fractal_noise(shape, 0.05 / texel_m, 1, rng)
    grain = rng.standard_normal(shape, dtype=np.float32)
    log_brick = np.log(tone) + 0.28 * shade[course, brick] + 0.14 * rough + 0.10 * grain
    log_mortar = np.log(0.55) + 0.05 * rough + 0.12 * grain
    log_tone = np.where(edge > 0.5 * joint_m, log_brick, log_mortar)
    log_tone -= 0.9 * np.exp(-(((edge - 0.45 * joint_m) / 0.0025) ** 2))
    return np.exp(log_tone, dtype=np.float32)
