"""A hand-knotted carpet."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.textures.fractal_noise import Float32
from eres_render.textures.reflectance import saturated

Bool = NDArray[np.bool_]

# Share of the dye's contrast left in the worn carpet. Calibrated, with the yarns, so that two
# images 50 ms apart at 0.9 m/s score about 13.5 dB against each other.
_CONTRAST = 0.6

_KNOT_TEXELS = 4  # width of a knot, the smallest element of the design

# Reflectance of the dyed yarns, new.
_IVORY, _GOLD, _ROSE, _RED, _INDIGO, _UMBER = 0.52, 0.41, 0.31, 0.25, 0.16, 0.09


def bokhara(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a hand-knotted carpet of the Bokhara kind.

    A field of octagonal guls within star and zigzag borders is knotted in six yarns, knot by knot,
    so every outline is stepped. On top come, from large to small: fading, the bands of the dye
    lots, uneven knots, the shadow between knots, and the fibers of the pile.

    Parameters
    ----------
    width_px, height_px
        Texels along the columns' and the rows' direction.
    texel_m
        Size of a texel.
    seed
        Seed of all irregularity; the design is always the same.

    Returns
    -------
    reflectance
        (height_px, width_px) float32 in [0.02, 0.85].
    """
    rng = np.random.default_rng(seed)
    rows, columns = -(-height_px // _KNOT_TEXELS), -(-width_px // _KNOT_TEXELS)
    knot_m = _KNOT_TEXELS * texel_m
    x, y = np.meshgrid(
        (np.arange(columns) - 0.5 * (columns - 1)) * knot_m,
        (np.arange(rows) - 0.5 * (rows - 1)) * knot_m,
    )

    half_m = (0.5 * width_px * texel_m, 0.5 * height_px * texel_m)
    log_knot = np.log(_design(x, y, half_m)).astype(np.float32)
    log_knot += 0.10 * _dye_lots(rows, rng)[:, None]
    log_knot += 0.22 * rng.standard_normal((rows, columns), dtype=np.float32)

    shape = (height_px, width_px)
    log_reflectance = _knots_to_texels(log_knot, shape, rng)
    log_reflectance += 0.08 * _fading(shape, rng)
    log_reflectance += _pile(shape, rng)
    middle = math.log(_RED)
    return saturated(middle + _CONTRAST * (log_reflectance - middle))


def _design(x: NDArray[np.float64], y: NDArray[np.float64], half_m: tuple[float, float]) -> Float32:
    """Return the yarn's reflectance at points in meters from the carpet's center."""
    yarn = np.full(x.shape, _RED, dtype=np.float32)

    def paint(where: Bool, reflectance: float) -> None:
        yarn[where] = reflectance

    def octagon(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the half-width of the octagon, a little wider than high, through (u, v)."""
        return np.maximum(np.maximum(abs(u), 1.2 * abs(v)), 0.72 * (abs(u) + 1.2 * abs(v)))

    def diamond(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        return abs(u) + abs(v)

    def star(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the size of the eight-pointed star (two squares) through (u, v)."""
        return np.minimum(np.maximum(abs(u), abs(v)), 0.7071 * diamond(u, v))

    def repeat(u: NDArray[np.float64], period_m: float) -> NDArray[np.float64]:
        """Fold the line into one period about 0."""
        return u - period_m * np.round(u / period_m)

    # The ground: a lattice of fine lines with a flower in each mesh.
    u, v = repeat(x, 0.06), repeat(y, 0.06)
    paint(diamond(u, v) < 0.020, _ROSE)
    paint(diamond(u, v) < 0.011, _UMBER)
    paint(diamond(repeat(x + 0.03, 0.06), repeat(y + 0.03, 0.06)) < 0.0075, _GOLD)

    # Lines that join the guls, and the small guls where they are farthest from the large ones.
    gul_x_m, gul_y_m = 0.46, 0.38
    u, v = repeat(x, gul_x_m), repeat(y, gul_y_m)
    paint((abs(u) < 0.006) | (abs(v) < 0.006), _INDIGO)
    s, t = repeat(x + 0.5 * gul_x_m, gul_x_m), repeat(y + 0.5 * gul_y_m, gul_y_m)
    for size_m, reflectance in ((0.094, _UMBER), (0.086, _IVORY), (0.066, _INDIGO), (0.054, _GOLD)):
        paint(diamond(s, 1.2 * t) < size_m, reflectance)
    paint((abs(s) < 0.012) & (abs(t) < 0.075), _UMBER)
    paint((abs(t) < 0.012) & (abs(s) < 0.095), _UMBER)
    paint(star(s, t) < 0.016, _IVORY)

    # The large guls: an octagon in quarters of two colors, a frame of hooks, a star in the middle.
    gul = octagon(u, v)
    quarter = (u * v) > 0
    paint(gul < 0.172, _UMBER)
    paint(gul < 0.164, _IVORY)
    paint((gul < 0.156) & quarter, _INDIGO)
    paint((gul < 0.156) & ~quarter, _GOLD)
    petals = diamond(repeat(u + 0.018, 0.036), repeat(v + 0.018, 0.036)) < 0.012
    paint((gul < 0.146) & petals & quarter, _IVORY)
    paint((gul < 0.146) & petals & ~quarter, _UMBER)
    paint(gul < 0.098, _UMBER)
    paint(gul < 0.091, _ROSE)
    hooks = (abs(repeat(np.arctan2(v, u), np.pi / 6)) < 0.10) & (gul < 0.091)
    paint(hooks, _IVORY)
    paint(star(u, v) < 0.050, _UMBER)
    paint(star(u, v) < 0.043, _IVORY)
    paint(star(u, v) < 0.026, _RED)
    paint(star(u, v) < 0.014, _UMBER)

    # The borders, told by the distance from the edge; `along` runs along the nearest side.
    inset_x, inset_y = half_m[0] - abs(x), half_m[1] - abs(y)
    inset = np.minimum(inset_x, inset_y)
    along = np.where(inset_x < inset_y, y, x)
    edge = 1.20  # where the field begins: 1.30 m from the middle of a 5 m carpet
    paint(inset < edge, _UMBER)
    paint(inset < edge - 0.015, _IVORY)
    zigzag = abs(repeat(along, 0.08)) - 0.02
    paint((inset < edge - 0.015) & (inset < edge - 0.055 + zigzag), _INDIGO)
    paint(inset < edge - 0.095, _UMBER)
    paint(inset < edge - 0.110, _ROSE)
    s, t = repeat(along, 0.24), inset - (edge - 0.245)
    in_band = abs(t) < 0.135
    paint(in_band & (diamond(repeat(along, 0.048), repeat(t, 0.048)) < 0.010), _UMBER)
    k, q = repeat(along + 0.12, 0.24), t
    for size_m, reflectance in ((0.062, _UMBER), (0.054, _GOLD), (0.034, _INDIGO), (0.016, _IVORY)):
        paint(in_band & (diamond(k, 0.6 * q) < size_m), reflectance)
    for size_m, reflectance in (
        (0.086, _UMBER),
        (0.079, _IVORY),
        (0.054, _RED),
        (0.040, _INDIGO),
        (0.024, _GOLD),
        (0.011, _UMBER),
    ):
        paint(in_band & (star(s, t) < size_m), reflectance)
    paint(inset < edge - 0.380, _UMBER)
    paint(inset < edge - 0.395, _GOLD)
    paint((inset < edge - 0.395) & (inset < edge - 0.435 + zigzag), _RED)
    paint(inset < edge - 0.475, _UMBER)

    # Beyond them a plain ground with a small repeat, out to the edge.
    ground = inset < edge - 0.490
    paint(ground, _ROSE)
    paint(ground & (diamond(repeat(x, 0.09), repeat(y, 0.09)) < 0.030), _INDIGO)
    paint(ground & (diamond(repeat(x, 0.09), repeat(y, 0.09)) < 0.016), _IVORY)
    return yarn


def _dye_lots(n_rows: int, rng: np.random.Generator) -> Float32:
    """Return a shade for each row of knots, standard deviation about 1: dye lots and yarn ends."""
    lots = np.repeat(rng.standard_normal(n_rows), rng.integers(5, 60, n_rows))[:n_rows]
    return (0.8 * lots + 0.6 * rng.standard_normal(n_rows)).astype(np.float32)


def _fading(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Return noise, the same variance in each octave from a quarter of the width to 16 texels."""
    height, width = shape
    total = np.zeros(shape, dtype=np.float32)
    cells = 4
    while cells <= width // 16:
        octave = rng.standard_normal((cells, cells), dtype=np.float32)
        total += cv2.resize(octave, (width, height), interpolation=cv2.INTER_LINEAR)
        cells *= 2
    return total


def _knots_to_texels(
    log_knot: Float32, shape: tuple[int, int], rng: np.random.Generator
) -> Float32:
    """Lay the knots out on texels, each row and column of them a little crooked."""
    rows, columns = log_knot.shape
    coarse = rng.standard_normal((2, rows // 8 + 2, columns // 8 + 2), dtype=np.float32)
    texel = np.arange(max(shape), dtype=np.float32) / _KNOT_TEXELS - 0.5 + 0.5 / _KNOT_TEXELS
    bend_x, bend_y = (cv2.resize(b, shape[::-1], interpolation=cv2.INTER_CUBIC) for b in coarse)
    bend_x *= 0.35
    bend_x += texel[: shape[1]]
    bend_y *= 0.35
    bend_y += texel[: shape[0], None]
    texels = cv2.remap(log_knot, bend_x, bend_y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REFLECT)
    return texels.astype(np.float32, copy=False)


def _pile(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Return the log shading of the pile: tufts with shadow between them, made of single fibers."""
    rows, columns = (np.arange(side) for side in shape)
    tuft_y, tuft_x = (
        np.sin(np.pi * ((along % _KNOT_TEXELS + np.float32(0.5)) / _KNOT_TEXELS))
        for along in (rows.astype(np.float32), columns.astype(np.float32))
    )
    shading = np.log(0.35 + 0.65 * np.sqrt(np.outer(tuft_y, tuft_x)), dtype=np.float32)

    # Fibers are short strokes; in every other tuft they lean the other way.
    grain = rng.standard_normal(shape, dtype=np.float32)
    stroke = np.eye(3, dtype=np.float32)
    lean_left = cv2.filter2D(grain, -1, stroke / np.linalg.norm(stroke))
    lean_right = cv2.filter2D(grain, -1, stroke[::-1] / np.linalg.norm(stroke))
    even = (rows[:, None] // _KNOT_TEXELS + columns // _KNOT_TEXELS) % 2 == 0
    shading += 0.55 * np.where(even, lean_left, lean_right)
    return shading
