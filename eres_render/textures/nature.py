"""Leaves, earth, glazed clay, fruit; and the view from a window."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise


def leaf(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.16
) -> Float32:
    """Return a leaf along v: midrib, side veins, blotches."""
    height, width = shape
    u = np.abs(np.linspace(-1, 1, width, dtype=np.float32))[None, :]
    v = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    veins = np.abs(np.sin(np.pi * (9 * v + 2.2 * u))) < 0.12
    log_tone = np.log(tone) + 0.22 * fractal_noise(shape, 24, 1, rng)
    log_tone = np.where(veins, log_tone + 0.45, log_tone)
    log_tone = np.where(u < 0.07, np.log(2.6 * tone), log_tone)
    return np.exp(log_tone, dtype=np.float32)


def earth(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return potting soil."""
    crumbs = fractal_noise(shape, 16, 1, rng, fall=1.2)
    return np.exp(np.log(0.07) + 0.5 * crumbs, dtype=np.float32)


def glaze(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.4
) -> Float32:
    """Return glazed clay with painted bands and crackle."""
    log_tone = np.log(tone) + 0.10 * fractal_noise(shape, 0.05 / texel_m, 1, rng)
    y = np.linspace(0, 1, shape[0], dtype=np.float32)[:, None]
    x = np.linspace(0, 1, shape[1], dtype=np.float32)[None, :]
    wave = np.abs(y - 0.35 - 0.04 * np.sin(2 * np.pi * 12 * x))
    log_tone = np.where((wave < 0.03) | (np.abs(y - 0.55) < 0.02), np.log(0.3 * tone), log_tone)
    log_tone = np.where(np.abs(y - 0.2) < 0.02, np.log(min(1.9 * tone, 0.8)), log_tone)
    crackle = np.abs(fractal_noise(shape, 0.03 / texel_m, 2, rng)) < 0.05
    return np.exp(log_tone - 0.25 * crackle, dtype=np.float32)


def peel(
    shape: tuple[int, int], texel_m: float, rng: np.random.Generator, tone: float = 0.4
) -> Float32:
    """Return the skin of a fruit: pores and blush."""
    blush = fractal_noise(shape, 0.1 / texel_m, 0.02 / texel_m, rng)
    pores = np.maximum(fractal_noise(shape, 3, 1, rng) - 0.8, 0)
    return np.exp(np.log(tone) + 0.15 * blush - 0.5 * pores, dtype=np.float32)


def garden_view(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the radiance of a hazy garden, W m^-2 sr^-1: sky, tree line, hedge, leaves.

    At sunset the sky, about 0.5, is not much brighter than a wall in lamplight (about 75 against 30
    cd/m^2 in a real room).
    """
    rng = np.random.default_rng(seed)
    shape = (height_px, width_px)
    y = np.linspace(0, 1, height_px, dtype=np.float32)[:, None]
    clouds = fractal_noise(shape, 0.4 / texel_m, 2, rng)
    view = np.float32(0.5) * np.exp(0.16 * clouds - 0.25 * y, dtype=np.float32)
    layers = ((0.55, 0.10, 0.22, 0.30), (0.66, 0.06, 0.14, 0.40), (0.82, 0.05, 0.08, 0.55))
    for level, reach, radiance, contrast in layers:
        outline = fractal_noise((4, width_px), 0.5 / texel_m, 2, rng, fall=0.75)[0]
        leaves = fractal_noise(shape, 0.06 / texel_m, 1, rng)
        foliage = radiance * np.exp(contrast * leaves - 0.5 * contrast**2)
        view = np.where(y > level - reach * outline, foliage, view).astype(np.float32)
    return view
