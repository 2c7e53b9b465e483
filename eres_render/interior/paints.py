"""Painters for charts: materials with their tones."""

from __future__ import annotations

from functools import partial

from eres_render.interior.uv_charts import FacePainter, Painter
from eres_render.textures.cloth import striped, tweed
from eres_render.textures.masonry import plaster
from eres_render.textures.nature import glaze
from eres_render.textures.wood import wood


def wooden(tone: float, ring_m: float = 0.018) -> FacePainter:
    """Return wood with its grain along a board's longest side and growth rings `ring_m` apart."""
    return lambda along_u: partial(wood, tone=tone, along_u=along_u, ring_m=ring_m)


def everywhere(paint: Painter) -> FacePainter:
    """Return one painter for all faces of a box."""
    return lambda _: paint


def upholstered(tone: float) -> FacePainter:
    """Return tweed."""
    return everywhere(partial(tweed, tone=tone))


def lacquered(tone: float) -> FacePainter:
    """Return brushed lacquer, which has the fine relief and grain of plaster."""
    return everywhere(partial(plaster, tone=tone))


def cushion(*tones: float) -> FacePainter:
    """Return striped cloth."""
    return everywhere(partial(striped, tones=tones))


def glazed(tone: float) -> Painter:
    """Return glazed clay."""
    return partial(glaze, tone=tone)
