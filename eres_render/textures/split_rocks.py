"""Split rock: flat facets with sharp edges and dark cracks, blocks within blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eres_render.textures.fractal_noise import Float32, fractal_noise
from eres_render.textures.reflectance import saturated

# Splits from coarse to fine: size of a facet, m; how log reflectance varies from facet to facet
# and along each; width of the cracks between them, m, and how much darker they are.
_SPLITS = (
    (0.35, 0.40, 0.25, 0.008, 1.6),
    (0.09, 0.30, 0.20, 0.003, 1.0),
    (0.03, 0.20, 0.15, 0.0, 0.6),
)
_STRATA_M = 0.05  # from one layer of the rock to the next


def split_rocks(width_px: int, height_px: int, texel_m: float, seed: int) -> Float32:
    """Return the reflectance of a print of split rocks; `texel_m` is a size on the rocks."""
    rng = np.random.default_rng(seed)
    shape = (height_px, width_px)
    log_reflectance = -1.35 + 0.25 * fractal_noise(shape, 0.2 / texel_m, 1, rng)
    log_reflectance += 0.18 * rng.standard_normal(shape, dtype=np.float32)
    rows, columns = np.mgrid[:height_px, :width_px].astype(np.float32)
    for k, (size_m, spread, tilt, crack_m, darkness) in enumerate(_SPLITS):
        size = size_m / texel_m
        facet, middles = _facets(shape, size, rng)
        count = len(middles)
        tone = spread * rng.standard_normal(count, dtype=np.float32)
        slope = (tilt / size) * rng.standard_normal((count, 2), dtype=np.float32)
        level = tone - np.sum(slope * middles, axis=1)
        log_reflectance += level[facet] + slope[facet, 0] * rows + slope[facet, 1] * columns
        if k == 0:
            turn = rng.uniform(0, np.pi, count).astype(np.float32)
            wave = np.float32(2 * np.pi * texel_m / _STRATA_M)
            along = np.sin(turn)[facet] * rows + np.cos(turn)[facet] * columns
            log_reflectance += 0.12 * np.sin(wave * along)
        log_reflectance -= np.float32(darkness) * _cracks(facet, crack_m / texel_m)
    return saturated(log_reflectance)


def _facets(
    shape: tuple[int, int], size: float, rng: np.random.Generator
) -> tuple[NDArray[np.int32], Float32]:
    """Return the facet of each texel and the facets' middles (row, column): Voronoi cells."""
    import cv2

    height, width = shape
    count = max(2, round(height * width / size**2))
    away = np.ones(shape, np.uint8)
    away[rng.integers(height, size=count), rng.integers(width, size=count)] = 0
    middles = np.argwhere(away == 0)
    _, label = cv2.distanceTransformWithLabels(
        away, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    number = np.empty(len(middles) + 1, np.int32)
    number[label[middles[:, 0], middles[:, 1]]] = np.arange(len(middles))
    return number[label], middles.astype(np.float32)


def _cracks(facet: NDArray[np.int32], width: float) -> Float32:
    """Return how much of a texel is crack, 0 to 1: 1 between facets, less beside."""
    import cv2

    edge = np.zeros(facet.shape, np.float32)
    edge[:, 1:] += facet[:, 1:] != facet[:, :-1]
    edge[1:] += facet[1:] != facet[:-1]
    side = 2 * int(0.5 * width) + 1
    wide = cv2.dilate(edge, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)))
    return np.asarray(cv2.GaussianBlur(np.minimum(wide, 1.0), (0, 0), 0.7), np.float32)
