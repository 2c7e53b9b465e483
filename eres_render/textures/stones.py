"""A bed of stones seen from above: boulders, pebbles, gravel and sand, down to a texel."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render.compiling import compiler
from eres_render.textures.fractal_noise import Float32, fractal_noise
from eres_render.textures.reflectance import saturated
from eres_render.textures.relief import log_light

jit = compiler(Path(__file__).parent)

# Radii of stones: from a small boulder to a grain of sand. The number of stones tried per area goes
# with radius^-2 per octave, the scale-free law of a dead-leaves mosaic. Stones without room are
# dropped, so that large stones are whole and small ones fill the gaps.
_MAX_M = 0.16
_MIN_PX = 1.6
_TRIES = 2.2  # area of the stones tried in an octave, over the area of the bed
_OVERLAP = 2  # of 12 points on a stone's rim, how many may lie on a stone placed before it

_FACETS = 7  # half-planes that cut a stone's outline
_OUTLINES = 1024  # different ones; each stone turns and flattens its own
SUN = (-0.60, -0.75, 0.60)  # toward the light that shades the stones: left, above, out of the bed
_SKY = 0.45  # share of the light that comes from everywhere

# Middle of the log reflectance before and after its contrast is reduced, as if by dust.
# Calibrated, with the rocks' speckle and the dark of the gaps, so that two images 50 ms apart at
# 0.7 m/s score about 13 dB against each other and ideal event integration comes within 0.7 dB of
# the paper's scores at each resolution.
MIDDLE_FROM, _MIDDLE_TO = -2.09, -1.42
_CONTRAST, _SHADING = 0.45, 0.62

# The kinds of rock: log reflectance, how it varies from stone to stone and within a stone.
_KINDS = np.array(
    [
        # mean, spread, grain, speckle, bands, veins
        [-1.25, 0.22, 0.22, 0.50, 0.00, 0.3],  # limestone
        [-2.05, 0.25, 0.16, 0.47, 0.05, 0.5],  # basalt
        [-1.45, 0.25, 0.20, 0.77, 0.00, 0.1],  # granite
        [-1.55, 0.25, 0.18, 0.50, 0.35, 0.2],  # banded gneiss
        [-0.65, 0.18, 0.16, 0.43, 0.00, 0.1],  # quartz
    ],
    dtype=np.float32,
)
_SHARES = np.array([0.30, 0.24, 0.20, 0.16, 0.10])


def pebble_bed(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a bed of stones, laid down from large to small wherever they fit.

    The relief is shaded once, by a fixed light and the sky. That shading is part of the texture:
    the bed is rendered as a flat, Lambertian surface.
    """
    log_reflectance, relief = unlit_bed(width_px, height_px, texel_m, seed)
    log_reflectance = _MIDDLE_TO + _CONTRAST * (log_reflectance - MIDDLE_FROM)
    log_reflectance += np.float32(_SHADING) * log_light(relief, SUN, _SKY)
    return saturated(log_reflectance)


def unlit_bed(width_px: int, height_px: int, texel_m: float, seed: int) -> tuple[Float32, Float32]:
    """Return log reflectance and relief, texels, of a bed of stones before light falls on it."""
    rng = np.random.default_rng(seed)
    shape = (height_px, width_px)
    radius_px = _radii(shape, _MAX_M / texel_m, rng)
    n = len(radius_px)
    kind = np.searchsorted(np.cumsum(_SHARES)[:-1], rng.random(n, dtype=np.float32))
    numbers = rng.random((n, 6), dtype=np.float32)
    mean = rng.standard_normal(n, dtype=np.float32)
    mean *= _KINDS[kind, 1]
    mean += _KINDS[kind, 0]
    outlines = rng.random((_OUTLINES, _FACETS, 2))

    # Sand below everything.
    sand = fractal_noise(shape, 64, 1, rng)
    grain = fractal_noise(shape, 256, 1, rng, fall=0.85)
    swirl = fractal_noise(shape, 256, 24, rng)
    speckle = rng.standard_normal(shape, dtype=np.float32)
    relief = 0.6 * sand
    log_reflectance: Float32 = -1.7 + 0.25 * sand + 0.60 * speckle
    owner = np.full(shape, -1, dtype=np.int32)
    stones = (radius_px, numbers, mean, kind, outlines)
    _lay_stones(owner, relief, log_reflectance, stones, (grain, swirl, speckle))
    relief = relief + 0.12 * speckle + 0.25 * grain
    return log_reflectance, relief


def _radii(shape: tuple[int, int], largest_px: float, rng: np.random.Generator) -> Float32:
    """Return the radii of the stones to try, in texels, from large to small."""
    area = shape[0] * shape[1]
    octaves = [np.empty(0, np.float32)]
    top = largest_px
    while top > _MIN_PX:
        low = max(top / 2, _MIN_PX)
        # Density r^-3 within an octave: the same area of stones from every scale.
        mean_area = math.pi * low * top * math.log(top / low) / (1 - low / top) / (top / low)
        count = int(_TRIES * math.log2(top / low) * area / mean_area)
        u = rng.random(count, dtype=np.float32)
        octaves.append(low * top / (top - u * np.float32(top - low)))
        top = low
    return -np.sort(-np.concatenate(octaves))


@jit
def _lay_stones(
    owner: NDArray[np.int32],
    relief: Float32,
    log_reflectance: Float32,
    stones: tuple[Any, ...],
    fields: tuple[Float32, Float32, Float32],
) -> None:
    """Lay the stones down in order: fill in each texel's owner, relief and log reflectance."""
    radius_px, numbers, mean, kind, outlines = stones
    grain, swirl, speckle = fields
    height, width = owner.shape
    nx, ny, reach = np.empty(_FACETS), np.empty(_FACETS), np.empty(_FACETS)
    for k in range(len(radius_px)):
        r = radius_px[k]
        cx, cy = numbers[k, 0] * width, numbers[k, 1] * height
        ix, iy = int(cx), int(cy)
        if owner[iy, ix] >= 0:
            continue
        turn = 2 * math.pi * numbers[k, 2]
        flat = 0.68 + 0.30 * numbers[k, 3]  # short axis over long axis
        ca, sa = math.cos(turn), math.sin(turn)
        taken = 0
        for j in range(12):
            a = 2 * math.pi * j / 12
            px, py = r * math.cos(a), r * flat * math.sin(a)
            x, y = int(cx + ca * px - sa * py), int(cy + sa * px + ca * py)
            if 0 <= x < width and 0 <= y < height and owner[y, x] >= 0:
                taken += 1
        if taken > _OVERLAP:
            continue
        outline = outlines[k % _OUTLINES]
        for j in range(_FACETS):
            a = 2 * math.pi * (j + 0.8 * (outline[j, 0] - 0.5)) / _FACETS
            nx[j], ny[j] = math.cos(a), math.sin(a)
            reach[j] = 0.80 + 0.30 * outline[j, 1]
        steep = 0.45 + 0.35 * numbers[k, 4]  # of the dome: its height over its radius
        rough, spots, bands, veins = _KINDS[kind[k], 2:]
        shift_x, shift_y = int(7919 * numbers[k, 2] * width), int(7907 * numbers[k, 3] * height)
        period = r * (0.12 + 0.25 * numbers[k, 5])
        vein_at = 1.4 * (numbers[k, 5] - 0.5) if numbers[k, 4] < veins else 9.0
        vein_width = 0.02 + 0.05 * numbers[k, 2]
        reach_px = int(1.15 * r) + 2
        base = 0.25 * r  # larger stones stand higher above the sand
        for y in range(max(0, iy - reach_px), min(height, iy + reach_px + 1)):
            for x in range(max(0, ix - reach_px), min(width, ix + reach_px + 1)):
                if owner[y, x] >= 0:
                    continue
                dx, dy = x + 0.5 - cx, y + 0.5 - cy
                u, v = (ca * dx + sa * dy) / r, (ca * dy - sa * dx) / (r * flat)
                if u * u + v * v > 1.35:
                    continue
                # A soft maximum over the facets: 1 on the outline, rounded at its corners.
                total = 0.0
                for j in range(_FACETS):
                    d = (u * nx[j] + v * ny[j]) / reach[j]
                    if d > 0:
                        d *= d
                        total += d * d * d
                # Every stone has its own piece of the grain; mirrored, it has no seams.
                gy, gx = (y + shift_y) % (2 * height), (x + shift_x) % (2 * width)
                gy, gx = min(gy, 2 * height - 1 - gy), min(gx, 2 * width - 1 - gx)
                g, w = grain[gy, gx], swirl[gy, gx]
                s = total ** (1.0 / 6.0) + 0.02 * w
                if s >= 1.0:
                    continue
                dome = math.sqrt(1.0 - s * s * s)
                owner[y, x] = k
                relief[y, x] = base + steep * r * dome
                value = mean[k] + rough * g + spots * speckle[gy, gx]
                if bands > 0:
                    value += bands * math.sin(2 * math.pi * r * (v + 0.10 * w) / period)
                if abs(v + 0.08 * w + 0.02 * g + 0.25 * u - vein_at) < vein_width:
                    value += 0.5 * (-0.8 - value)
                log_reflectance[y, x] = value
