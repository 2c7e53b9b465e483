"""Light on a relief: the sun with the shadows that it casts, and the visible part of the sky."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eres_render.compiling import compiler
from eres_render.textures.fractal_noise import Float32

jit = compiler(Path(__file__).parent)

_SKY_ELEVATIONS_DEG = (20.0, 55.0)
"""Of the directions that stand for the sky, 8 at each: bands of about the same horizontal flux."""


class Faces(NamedTuple):
    """Slopes of a relief's texels along x and y, and the upward component of their unit normals."""

    slope_x: Float32
    slope_y: Float32
    up: Float32

    def cosine(self, x: float, y: float, z: float) -> Float32:
        """Return the cosine between the normals of the faces and a direction."""
        flat = np.float32(x) * self.slope_x, np.float32(y) * self.slope_y
        return (np.float32(z) - flat[0] - flat[1]) * self.up


def faces_of(relief: Float32) -> Faces:
    """Return the faces of a relief of heights in texels."""
    import cv2

    slope_x, slope_y = (
        cv2.Sobel(relief, cv2.CV_32F, dx, 1 - dx, ksize=1, scale=0.5).astype(np.float32, copy=False)
        for dx in (1, 0)
    )
    up = 1 / np.sqrt(1 + np.square(slope_x) + np.square(slope_y))
    return Faces(slope_x, slope_y, up)


def log_light(
    relief: Float32, sun: tuple[float, float, float], sky: float, least: float = 0.015
) -> Float32:
    """Return the log of the irradiance on a relief (heights in texels), 0 on level ground.

    Every texel is lit by a sun and by 16 directions that stand for a uniform sky, if not blocked.
    """
    faces = faces_of(relief)
    x, y, z = np.asarray(sun, np.float64) / np.linalg.norm(sun)
    light = np.full_like(relief, least)
    lamps = [(x, y, z, 1 - sky)]
    for elevation_deg in _SKY_ELEVATIONS_DEG:
        flat, high = (f(math.radians(elevation_deg)) for f in (math.cos, math.sin))
        turns = [math.radians(22.5 + 45 * k) for k in range(8)]
        lamps += [(flat * math.cos(a), flat * math.sin(a), high, sky / 16) for a in turns]
    for x, y, z, share in lamps:
        _add_lamp(relief, faces, x, y, z, share / z, light)  # level ground gets `share`
    return np.log(light, out=light)


def lit(relief: Float32, x: float, y: float, z: float) -> Float32:
    """Return the share of a distant lamp that each texel of a relief (heights in texels) sees."""
    visible = np.empty_like(relief)
    _lit(relief, x, y, z, visible)
    return visible


@jit
def _lit(relief: Float32, x: float, y: float, z: float, visible: Float32) -> None:
    """Write the share of a lamp that each texel sees."""
    rows, columns = relief.shape
    horizon, nearer = np.empty(columns, np.float32), np.empty(columns, np.float32)
    for i in range(rows):
        row = i if y <= 0 else rows - 1 - i
        nearer, horizon = horizon, nearer
        _shade_row(relief[row], x, y, z, i == 0, nearer, horizon, visible[row])


@jit
def _add_lamp(
    relief: Float32, faces: Faces, x: float, y: float, z: float, power: float, light: Float32
) -> None:
    """Add the light of a lamp of unit direction, `power` on a face that looks at it."""
    rows, columns = relief.shape
    horizon, nearer = np.empty(columns, np.float32), np.empty(columns, np.float32)
    visible = np.empty(columns, np.float32)
    to_x, to_y, to_z, strength = np.float32(x), np.float32(y), np.float32(z), np.float32(power)
    for i in range(rows):
        row = i if y <= 0 else rows - 1 - i
        nearer, horizon = horizon, nearer
        _shade_row(relief[row], x, y, z, i == 0, nearer, horizon, visible)
        slope_x, slope_y, up = faces.slope_x[row], faces.slope_y[row], faces.up[row]
        for k in range(columns):
            cosine = (to_z - to_x * slope_x[k] - to_y * slope_y[k]) * up[k]
            light[row, k] += max(cosine, np.float32(0)) * visible[k] * strength


@jit
def _shade_row(
    heights: Float32,
    x: float,
    y: float,
    z: float,
    first: bool,
    nearer: Float32,
    horizon: Float32,
    visible: Float32,
) -> None:
    """Fill in a row's `horizon`, below which all is in shadow, and its share of the lamp.

    `nearer` is the horizon of the row before, nearer to the lamp. Light that comes more along the
    rows than across them is followed from column to column, other light from row to row.
    """
    columns = len(heights)
    step = 1 if x <= 0 else -1  # away from the lamp
    start = 0 if x <= 0 else columns - 1
    if abs(x) > abs(y):
        aside, drop = abs(y / x), z / abs(x)
        above = horizon if first else nearer
        horizon[start], visible[start] = heights[start], 1.0
        for k in range(start + step, start + step * columns, step):
            line = (1 - aside) * horizon[k - step] + aside * above[k - step] - drop
            visible[k] = min(1.0, max(0.0, 1.0 - (line - heights[k])))
            horizon[k] = max(heights[k], line)
    elif first:
        for k in range(columns):
            horizon[k], visible[k] = heights[k], 1.0
    else:
        aside, drop = abs(x / y), z / abs(y)
        for k in range(columns):
            beside = min(max(k - step, 0), columns - 1)
            line = (1 - aside) * nearer[k] + aside * nearer[beside] - drop
            visible[k] = min(1.0, max(0.0, 1.0 - (line - heights[k])))
            horizon[k] = max(heights[k], line)
