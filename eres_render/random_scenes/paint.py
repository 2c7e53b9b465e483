"""Random painters: all patterns of `eres_render.textures` at random scale, tone and contrast."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from eres_render.interior.uv_charts import FacePainter, Painter
from eres_render.textures.carpet import bokhara
from eres_render.textures.cloth import kilim, striped, tweed
from eres_render.textures.fractal_noise import Float32, fractal_noise
from eres_render.textures.masonry import bricks, plaster, wallpaper
from eres_render.textures.nature import earth, glaze, peel
from eres_render.textures.printed import abstract, book_cover, landscape, poster, text_page
from eres_render.textures.stones import pebble_bed
from eres_render.textures.wood import planks, wood

_LOG_SCALE = np.log([0.25, 1.0])  # size of a texel in the pattern over its size on the surface
_LOG_SHADE = (-0.7, 0.0)  # of a chart, as if each faced the light in its own way
_CONTRAST = (0.5, 1.5)  # factor on log reflectance
# Letters and margins need some room: a pattern has at least this many texels along both sides;
# smaller faces are cut from it.
_MIN_TEXELS, _MIN_M = 64, 0.2
_COARSEST_M = 0.01  # texel of a pattern, whose details are some centimeters large


def random_painter(rng: np.random.Generator) -> FacePainter:
    """Return a pattern for all faces of a thing; each face has its own shade."""
    pattern = PATTERNS[rng.integers(len(PATTERNS))]
    scale = float(np.exp(rng.uniform(*_LOG_SCALE)))
    contrast = float(rng.uniform(*_CONTRAST))

    def face(along_u: bool) -> Painter:
        return partial(_painted, pattern, scale, contrast, float(rng.uniform(*_LOG_SHADE)))

    return face


def _painted(
    pattern: Painter,
    scale: float,
    contrast: float,
    log_shade: float,
    shape: tuple[int, int],
    texel_m: float,
    rng: np.random.Generator,
) -> Float32:
    """Paint a pattern with its contrast about the mean scaled, and darker by a shade."""
    texel_m = min(scale * texel_m, _COARSEST_M)
    least = max(_MIN_TEXELS, math.ceil(_MIN_M / texel_m))
    rows, columns = (max(side, least) for side in shape)
    whole = pattern((rows, columns), texel_m, rng)
    log_tone = np.log(np.maximum(whole[: shape[0], : shape[1]], 1e-3))
    mean = log_tone.mean()
    return np.exp(mean + contrast * (log_tone - mean) + log_shade, dtype=np.float32)


def _clouds(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
    """Return 1/f noise from the size of the surface down to a texel."""
    return np.exp(-1.2 + 0.4 * fractal_noise(shape, max(shape), 1, rng), dtype=np.float32)


def _seeded(make: Callable[[int, int, float, int], Float32]) -> Painter:
    """Return a painter that gives a texture generator a random seed."""

    def paint(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float32:
        return make(shape[1], shape[0], texel_m, int(rng.integers(1 << 32)))

    return paint


PATTERNS: tuple[Painter, ...] = (
    _clouds,
    *(plaster, wallpaper, bricks),
    *(tweed, striped, kilim),
    *(wood, planks),
    *(earth, glaze, peel),
    *(landscape, abstract, poster, text_page, book_cover),
    _seeded(bokhara),
    _seeded(pebble_bed),
)
"""Patterns of reflectance, each of any shape."""
