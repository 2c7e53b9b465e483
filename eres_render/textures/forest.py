"""A forest seen from within: trunks before the haze, and leaves of all sizes down to a texel."""

from __future__ import annotations

import numpy as np

from eres_render.textures.fractal_noise import Float32, fractal_noise
from eres_render.textures.reflectance import saturated

# Trunks from far to near: radius and mean distance between them, m; log reflectance.
_TRUNKS = ((0.04, 0.5, -1.55), (0.08, 1.0, -2.1), (0.15, 2.2, -2.6))

# Leaves from far to near: length, m; share of the area that they would cover without overlap; mean
# log reflectance and its standard deviation from leaf to leaf.
_LEAVES = (
    (0.02, 0.35, -1.2, 0.30),
    (0.045, 0.35, -1.6, 0.40),
    (0.10, 0.30, -2.0, 0.45),
    (0.20, 0.15, -2.2, 0.40),
)
_SLIM = 0.45  # width of a leaf over its length
_RIM = 12  # points of its outline
_SUBPIXEL_BITS = 4  # of OpenCV's coordinates


def forest(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a print of a forest; `texel_m` is a size in the forest."""
    rng = np.random.default_rng(seed)
    shape = (height_px, width_px)
    log_reflectance = -0.9 + 0.35 * fractal_noise(shape, 1.0 / texel_m, 1, rng)
    layers = [*zip(_LEAVES, (*_TRUNKS, None), strict=True)]
    for leaves, trunks in layers:
        _add_leaves(log_reflectance, leaves, texel_m, rng)
        if trunks is not None:
            _add_trunks(log_reflectance, trunks, texel_m, rng)
    log_reflectance += 0.25 * fractal_noise(shape, 16, 1, rng)
    log_reflectance += 0.12 * rng.standard_normal(shape, dtype=np.float32)
    return saturated(log_reflectance)


def _add_trunks(
    image: Float32, trunks: tuple[float, float, float], texel_m: float, rng: np.random.Generator
) -> None:
    """Paint trunks over an image of log reflectance: round, with bark along them."""
    radius_m, apart_m, tone = trunks
    height, width = image.shape
    count = rng.poisson(width * texel_m / apart_m)
    bark = fractal_noise(image.shape, max(radius_m / texel_m, 2), 1, rng, stretch=6)
    rows = np.arange(height)[:, None]
    for _ in range(count):
        middle = rng.uniform(0, width)
        lean = rng.normal(0, 0.06)
        radius = radius_m / texel_m * rng.uniform(0.6, 1.4)
        first = max(0, int(middle - radius - abs(lean) * height))
        last = min(width, int(middle + radius + abs(lean) * height) + 1)
        columns = np.arange(first, last)[None, :]
        across = (columns - middle - lean * (rows - 0.5 * height)) / radius
        shade = 0.35 * np.sqrt(np.clip(1 - across**2, 0, 1)) - 0.25 * across
        part = image[:, first:last]
        trunk = tone + shade + 0.35 * bark[:, first:last]
        part[...] = np.where(np.abs(across) < 1, trunk, part)


def _add_leaves(
    image: Float32,
    leaves: tuple[float, float, float, float],
    texel_m: float,
    rng: np.random.Generator,
) -> None:
    """Paint leaves over an image of log reflectance, one over the other."""
    import cv2

    length_m, cover, tone, spread = leaves
    height, width = image.shape
    length = length_m / texel_m
    count = int(cover * height * width / (np.pi / 4 * _SLIM * length**2))
    middles = rng.uniform((0, 0), (width, height), (count, 1, 2))
    turns = rng.uniform(0, 2 * np.pi, count)
    sizes = 0.5 * length * rng.uniform(0.6, 1.4, count)
    tones = rng.normal(tone, spread, count)
    angles = np.linspace(0, 2 * np.pi, _RIM, endpoint=False)
    # Pointed at both ends.
    rim = np.stack([np.cos(angles), _SLIM * np.sin(angles) * np.abs(np.sin(angles))], axis=-1)
    cos, sin = np.cos(turns), np.sin(turns)
    turned = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=-2)
    outlines = middles + sizes[:, None, None] * (rim @ np.swapaxes(turned, 1, 2))
    fixed = np.round(outlines * 2**_SUBPIXEL_BITS).astype(np.int32)
    for outline, value in zip(fixed, tones.tolist(), strict=True):
        cv2.fillConvexPoly(image, outline, value, cv2.LINE_8, _SUBPIXEL_BITS)
