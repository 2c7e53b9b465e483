"""Light on a relief: the sun with the shadows that it casts, and the visible part of the sky."""

from __future__ import annotations

import math

import cv2
import numba
import numpy as np

from eres_render.textures.fractal_noise import Float32

_SKY_ELEVATIONS_DEG = (20.0, 55.0)
"""Of the directions that stand for the sky, 8 at each: bands of about the same horizontal flux."""


def log_light(
    relief: Float32, sun: tuple[float, float, float], sky: float, least: float = 0.015
) -> Float32:
    """Return the log of the irradiance on a relief, 0 on level ground.

    Every texel is lit by a sun and by 16 directions that stand for a uniform sky, each as far as
    the relief does not block it.

    Parameters
    ----------
    relief
        (height, width) heights, texels.
    sun
        Direction to the sun: along the columns, along the rows, up.
    sky
        Share of the light on level ground that comes from the sky.
    least
        Light that reaches every texel, of that on level ground.

    Returns
    -------
    log_light
        (height, width) float32.
    """
    slope_x = cv2.Sobel(relief, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    slope_y = cv2.Sobel(relief, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    up = 1 / np.sqrt(1 + np.square(slope_x) + np.square(slope_y))
    x, y, z = np.asarray(sun, np.float64) / np.linalg.norm(sun)
    light = np.full_like(relief, least)
    lamps = [(x, y, z, 1 - sky)]
    for elevation_deg in _SKY_ELEVATIONS_DEG:
        flat, high = (f(math.radians(elevation_deg)) for f in (math.cos, math.sin))
        turns = [math.radians(22.5 + 45 * k) for k in range(8)]
        lamps += [(flat * math.cos(a), flat * math.sin(a), high, sky / 16) for a in turns]
    for x, y, z, share in lamps:
        facing = (np.float32(z) - np.float32(x) * slope_x - np.float32(y) * slope_y) * up
        np.maximum(facing, 0, out=facing)
        facing *= lit(relief, x, y, z)
        facing *= np.float32(share / z)  # level ground gets `share`
        light += facing
    return np.log(light, out=light)


def lit(relief: Float32, x: float, y: float, z: float) -> Float32:
    """Return the share of a distant lamp that each texel sees.

    Parameters
    ----------
    relief
        (height, width) heights, texels.
    x, y, z
        Direction to the lamp: along the columns, along the rows, up.

    Returns
    -------
    lit
        (height, width) float32 from 0, in shadow, to 1.
    """
    # The sweep wants the lamp above the first row, and nearer to it than to the first column.
    turned = abs(x) > abs(y)
    heights, (x, y) = (relief.T, (y, x)) if turned else (relief, (x, y))
    rows, columns = (slice(None, None, -1 if along > 0 else 1) for along in (y, x))
    seen = np.empty_like(heights)
    _sweep(
        np.ascontiguousarray(heights[rows, columns]),
        seen[rows, columns],
        abs(x / y),
        z / abs(y),
    )
    return seen.T if turned else seen


@numba.njit(cache=True)
def _sweep(heights: Float32, seen: Float32, sideways: float, drop: float) -> None:
    """Carry the height below which all is in shadow from row to row, away from the lamp.

    `sideways` is the columns that the light crosses for each row, 0 to 1, and `drop` how far it
    falls meanwhile.
    """
    rows, columns = heights.shape
    shadow = heights[0].copy()
    before = shadow.copy()
    seen[0] = 1.0
    for i in range(1, rows):
        before, shadow = shadow, before
        for k in range(columns):
            horizon = (1 - sideways) * before[k] + sideways * before[max(k - 1, 0)] - drop
            height = heights[i, k]
            seen[i, k] = min(1.0, max(0.0, 1.0 - (horizon - height)))
            shadow[k] = max(height, horizon)
