"""A hand-tufted carpet."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.compiling import compiler
from eres_render.textures.fractal_noise import Float32, fractal_noise
from eres_render.textures.reflectance import saturated
from eres_render.textures.relief import log_light

jit = compiler(Path(__file__).parent)

Bool = NDArray[np.bool_]

_TUFT_TEXELS = 6  # from one tuft of yarn to the next, 7 mm
_LENGTH, _BREADTH = 0.95, 0.48  # half axes of a tuft, in tufts; they lie on each other like tiles
_HEIGHT = 0.75  # of a tuft, in tufts
_LEAN = 0.35  # how much higher its tip is than its root, of the height
_BRUSHED, _SPREAD = 0.45, 0.7  # how the pile turns from place to place, from tuft to tuft, rad
_FIBER_SHADE = 0.07  # from fiber to fiber of a tuft, in log reflectance
_FADING = 0.30  # from place to place, in log reflectance when new
_LAMP = (0.80, -0.25, 0.55)  # toward the lamp that shades the pile
_SKY = 0.35  # share of the light that comes from everywhere

# Share of the dye's contrast that is left in the worn carpet, and of the pile's shading that the
# many lamps of a room leave. Calibrated so that two images 50 ms apart at 0.9 m/s score about
# 13.5 dB against each other, and on the spectral slope of the carpet's images.
_CONTRAST, _SHADING = 0.75, 0.17

# Reflectance of the dyed yarns, new, and of the weave between the tufts.
_IVORY, _GOLD, _ROSE, _RED, _INDIGO, _UMBER = 0.52, 0.41, 0.31, 0.25, 0.16, 0.09
_WEAVE = 0.15


def bokhara(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a hand-tufted carpet with a design of the Bokhara kind.

    Its relief is shaded once, by a low lamp and light from everywhere. That shading is part of the
    texture: the carpet is rendered as a flat, Lambertian surface.
    """
    rng = np.random.default_rng(seed)
    shape = (height_px, width_px)
    rows, columns = (-(-side // _TUFT_TEXELS) + 2 for side in shape)  # one more on either side
    tufts = (rows, columns)
    tuft_m = _TUFT_TEXELS * texel_m
    x, y = np.meshgrid(
        (np.arange(columns) - 0.5 * (columns - 1)) * tuft_m,
        (np.arange(rows) - 0.5 * (rows - 1)) * tuft_m,
    )
    half_m = (0.5 * width_px * texel_m, 0.5 * height_px * texel_m)
    log_yarn = np.log(_design(x, y, half_m)).astype(np.float32)
    log_yarn += 0.10 * _dye_lots(rows, rng)[:, None]
    log_yarn += 0.16 * _along_the_yarn(tufts, rng)
    log_yarn += 0.08 * rng.standard_normal(tufts, dtype=np.float32)
    log_yarn += _FADING * fractal_noise(tufts, max(columns / 4, 4), 4, rng)
    middle = math.log(_RED)
    log_yarn = middle + _CONTRAST * (log_yarn - middle)

    brushed = _BRUSHED * fractal_noise(tufts, 80, 10, rng)
    jitter = rng.random((rows, columns, 4), dtype=np.float32)
    fibers = _fibers(rng)
    relief = np.zeros(shape, dtype=np.float32)
    log_reflectance = np.full(shape, math.log(_WEAVE), dtype=np.float32)
    _lay_tufts(relief, log_reflectance, log_yarn, brushed, jitter, fibers)
    log_reflectance += np.float32(_SHADING) * log_light(relief, _LAMP, _SKY, least=0.05)
    return saturated(log_reflectance)


def _design(x: NDArray[np.float64], y: NDArray[np.float64], half_m: tuple[float, float]) -> Float32:
    """Return the yarn's reflectance at points in meters from the carpet's center."""
    yarn = np.full(x.shape, _RED, dtype=np.float32)

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
    u, v = repeat(x, 0.115), repeat(y, 0.095)
    yarn[diamond(u, v) < 0.036] = _ROSE
    yarn[diamond(u, v) < 0.017] = _UMBER

    # Lines that join the guls, and the small guls where they are farthest from the large ones.
    gul_x_m, gul_y_m = 0.46, 0.38
    u, v = repeat(x, gul_x_m), repeat(y, gul_y_m)
    yarn[(abs(u) < 0.010) | (abs(v) < 0.010)] = _INDIGO
    s, t = repeat(x + 0.5 * gul_x_m, gul_x_m), repeat(y + 0.5 * gul_y_m, gul_y_m)
    for size_m, reflectance in ((0.106, _UMBER), (0.092, _IVORY), (0.070, _INDIGO), (0.052, _GOLD)):
        yarn[diamond(s, 1.2 * t) < size_m] = reflectance
    yarn[(abs(s) < 0.012) & (abs(t) < 0.075)] = _UMBER
    yarn[(abs(t) < 0.012) & (abs(s) < 0.095)] = _UMBER
    yarn[star(s, t) < 0.016] = _IVORY

    # The large guls: an octagon in quarters of two colors, a frame of hooks, a star in the middle.
    gul = octagon(u, v)
    quarter = (u * v) > 0
    yarn[gul < 0.178] = _UMBER
    yarn[gul < 0.164] = _IVORY
    yarn[(gul < 0.150) & quarter] = _INDIGO
    yarn[(gul < 0.150) & ~quarter] = _GOLD
    petals = diamond(abs(u) - 0.115, abs(v) - 0.055) < 0.024
    yarn[petals & quarter] = _IVORY
    yarn[petals & ~quarter] = _UMBER
    yarn[gul < 0.100] = _UMBER
    yarn[gul < 0.086] = _ROSE
    hooks = (abs(repeat(np.arctan2(v, u), np.pi / 4)) < 0.14) & (gul < 0.086)
    yarn[hooks] = _IVORY
    for size_m, reflectance in ((0.054, _UMBER), (0.042, _IVORY), (0.026, _RED), (0.014, _UMBER)):
        yarn[star(u, v) < size_m] = reflectance

    # The borders, told by the distance from the edge; `along` runs along the nearest side.
    inset_x, inset_y = half_m[0] - abs(x), half_m[1] - abs(y)
    inset = np.minimum(inset_x, inset_y)
    along = np.where(inset_x < inset_y, y, x)
    edge = 1.20  # where the field begins: 1.30 m from the middle of a 5 m carpet
    yarn[inset < edge] = _UMBER
    yarn[inset < edge - 0.015] = _IVORY
    zigzag = abs(repeat(along, 0.08)) - 0.02
    yarn[(inset < edge - 0.015) & (inset < edge - 0.055 + zigzag)] = _INDIGO
    yarn[inset < edge - 0.095] = _UMBER
    yarn[inset < edge - 0.110] = _ROSE
    s, t = repeat(along, 0.24), inset - (edge - 0.245)
    in_band = abs(t) < 0.135
    yarn[in_band & (diamond(repeat(along, 0.048), repeat(t, 0.048)) < 0.010)] = _UMBER
    k, q = repeat(along + 0.12, 0.24), t
    for size_m, reflectance in ((0.062, _UMBER), (0.054, _GOLD), (0.034, _INDIGO), (0.016, _IVORY)):
        yarn[in_band & (diamond(k, 0.6 * q) < size_m)] = reflectance
    for size_m, reflectance in (
        (0.086, _UMBER),
        (0.079, _IVORY),
        (0.054, _RED),
        (0.040, _INDIGO),
        (0.024, _GOLD),
        (0.011, _UMBER),
    ):
        yarn[in_band & (star(s, t) < size_m)] = reflectance
    yarn[inset < edge - 0.380] = _UMBER
    yarn[inset < edge - 0.395] = _GOLD
    yarn[(inset < edge - 0.395) & (inset < edge - 0.435 + zigzag)] = _RED
    yarn[inset < edge - 0.475] = _UMBER

    # Beyond them a plain ground with a small repeat, out to the edge.
    ground = inset < edge - 0.490
    yarn[ground] = _ROSE
    yarn[ground & (diamond(repeat(x, 0.09), repeat(y, 0.09)) < 0.030)] = _INDIGO
    yarn[ground & (diamond(repeat(x, 0.09), repeat(y, 0.09)) < 0.016)] = _IVORY
    return yarn


def _dye_lots(n_rows: int, rng: np.random.Generator) -> Float32:
    """Return a shade for each row of tufts, standard deviation about 1: dye lots and yarn ends."""
    lots = np.repeat(rng.standard_normal(n_rows), rng.integers(5, 60, n_rows))[:n_rows]
    return (0.8 * lots + 0.6 * rng.standard_normal(n_rows)).astype(np.float32)


def _along_the_yarn(shape: tuple[int, int], rng: np.random.Generator) -> Float32:
    """Return the shade of uneven yarn, standard deviation about 1: it wanders along each row."""
    import cv2

    rows, columns = shape
    total = np.zeros(shape, dtype=np.float32)
    for tufts in (3, 12, 48):
        wander = rng.standard_normal((rows, columns // tufts + 2), dtype=np.float32)
        total += cv2.resize(wander, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return total


_STRANDS = 512  # sides of the square of fibers that tufts are cut from


def _fibers(rng: np.random.Generator) -> Float32:
    """Return the log shade of fibers that run along the columns, standard deviation 1."""
    import cv2

    grain = rng.standard_normal((_STRANDS, _STRANDS), dtype=np.float32)
    strands = cv2.GaussianBlur(grain, (0, 0), sigmaX=4.0, sigmaY=0.6)
    return (strands / strands.std()).astype(np.float32)


@jit
def _lay_tufts(
    relief: Float32,
    log_reflectance: Float32,
    log_yarn: Float32,
    brushed: Float32,
    jitter: Float32,
    fibers: Float32,
) -> None:
    """Fill in each texel's height, texels, and log reflectance from the highest tuft there."""
    height, width = relief.shape
    rows, columns = log_yarn.shape
    a, b, top = _LENGTH * _TUFT_TEXELS, _BREADTH * _TUFT_TEXELS, _HEIGHT * _TUFT_TEXELS
    reach = int(1.2 * a) + 1
    for i in range(rows):
        for k in range(columns):
            cy = (i - 0.5 + 0.7 * (jitter[i, k, 0] - 0.5)) * _TUFT_TEXELS
            cx = (k - 0.5 + 0.7 * (jitter[i, k, 1] - 0.5)) * _TUFT_TEXELS
            turn = brushed[i, k] + _SPREAD * (jitter[i, k, 2] - 0.5)
            size = 0.8 + 0.4 * jitter[i, k, 3]
            ca, sa = math.cos(turn), math.sin(turn)
            seed = 7919 * i + 104729 * k
            for y in range(max(0, int(cy) - reach), min(height, int(cy) + reach + 1)):
                for x in range(max(0, int(cx) - reach), min(width, int(cx) + reach + 1)):
                    dx, dy = x + 0.5 - cx, y + 0.5 - cy
                    u, v = (ca * dx + sa * dy) / (size * a), (ca * dy - sa * dx) / (size * b)
                    q = u * u + v * v
                    if q >= 1.0:
                        continue
                    z = size * top * (math.sqrt(1.0 - q) + _LEAN * u)
                    if z <= relief[y, x]:
                        continue
                    relief[y, x] = z
                    strand = (seed + int(2.0 * _TUFT_TEXELS * (v + 1.0))) % _STRANDS
                    along = (seed // 7 + int(_TUFT_TEXELS * (u + 1.0))) % _STRANDS
                    log_reflectance[y, x] = log_yarn[i, k] + _FIBER_SHADE * fibers[strand, along]
