"""The empty room: floor, ceiling, walls with a window and a door."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from eres_render.interior.paints import lacquered, wooden
from eres_render.interior.uv_charts import Chart, box, plate, rectangle
from eres_render.textures.masonry import bricks, plaster, wallpaper
from eres_render.textures.wood import planks

EAST_M, NORTH_M, HEIGHT_M = 6.4, 5.2, 2.7
"""Size of the room; the origin is its south-western corner on the floor."""

WINDOW_SOUTH_M, WINDOW_NORTH_M, WINDOW_LOW_M, WINDOW_HIGH_M = 1.3, 3.7, 0.9, 2.3
_REVEAL_M = 0.15


def floor() -> list[Chart]:
    """Return a plank floor, its boards from west to east."""
    paint = partial(planks, tone=0.30)
    return [rectangle((0, NORTH_M, 0), (EAST_M, 0, 0), (0, -NORTH_M, 0), paint)]


def ceiling() -> list[Chart]:
    """Return a plastered ceiling."""
    paint = partial(plaster, tone=0.78)
    return [rectangle((0, 0, HEIGHT_M), (EAST_M, 0, 0), (0, NORTH_M, 0), paint)]


def beams() -> list[Chart]:
    """Return four beams under the ceiling, from south to north."""
    charts = []
    for x in (0.75, 2.35, 3.95, 5.55):
        low, high = (x - 0.07, 0, HEIGHT_M - 0.16), (x + 0.07, NORTH_M, HEIGHT_M)
        charts += box(low, high, wooden(0.16, 0.03), without=("top", "south", "north"))
    return charts


def walls() -> list[Chart]:
    """Return papered and plastered walls, a brick one in the east, a hole for the window."""
    down = (0, 0, -HEIGHT_M)
    t = (0, 1 - WINDOW_HIGH_M / HEIGHT_M, 1 - WINDOW_LOW_M / HEIGHT_M, 1)
    s = (0, WINDOW_SOUTH_M / NORTH_M, WINDOW_NORTH_M / NORTH_M, 1)
    paper = partial(wallpaper, tone=0.5)
    west = plate(
        (0, 0, HEIGHT_M), (0, NORTH_M, 0), down, partial(plaster, tone=0.62), t, s, hole=(1, 1)
    )
    north = rectangle((0, NORTH_M, HEIGHT_M), (EAST_M, 0, 0), down, paper)
    east = rectangle((EAST_M, NORTH_M, HEIGHT_M), (0, -NORTH_M, 0), down, bricks)
    south = rectangle((EAST_M, 0, HEIGHT_M), (-EAST_M, 0, 0), down, paper)
    return [west, north, east, south]


def joinery() -> list[Chart]:
    """Return the window's reveal, frame and sill, the skirting boards, and the door."""
    white = lacquered(0.72)
    charts = _reveal()
    x0, x1 = -_REVEAL_M + 0.03, -_REVEAL_M + 0.09
    south, north, low, high = WINDOW_SOUTH_M, WINDOW_NORTH_M, WINDOW_LOW_M, WINDOW_HIGH_M
    posts = np.linspace(south + 0.03, north - 0.03, 4)
    for y, hidden in zip(posts, (("south",), (), (), ("north",)), strict=True):
        without = ("top", "bottom", *hidden)
        charts += box((x0, y - 0.03, low), (x1, y + 0.03, high), white, without)
    middle = 0.62 * high + 0.38 * low
    for z, hidden in ((low + 0.03, ("bottom",)), (middle, ()), (high - 0.03, ("top",))):
        without = ("south", "north", *hidden)
        for start, end in pairwise(posts):
            rail = (x0, start + 0.03, z - 0.03), (x1, end - 0.03, z + 0.03)
            charts += box(*rail, white, without)
    charts += box((-0.02, south - 0.08, low - 0.03), (0.12, north + 0.08, low + 0.005), white)

    board, thick = 0.08, 0.015
    inner = NORTH_M - thick
    ends = ("bottom", "south", "north")
    charts += box((0, thick, 0), (thick, inner, board), white, ("west", *ends))
    charts += box((EAST_M - thick, thick, 0), (EAST_M, inner, board), white, ("east", *ends))
    ends = ("bottom", "east", "west")
    charts += box((0, 0, 0), (4.22, thick, board), white, ("south", *ends))
    charts += box((5.28, 0, 0), (EAST_M, thick, board), white, ("south", *ends))
    charts += box((0, inner, 0), (EAST_M, NORTH_M, board), white, ("north", *ends))
    return charts + _door(4.3, 5.2)


def _reveal() -> list[Chart]:
    south, north, low, high = WINDOW_SOUTH_M, WINDOW_NORTH_M, WINDOW_LOW_M, WINDOW_HIGH_M
    paint = partial(plaster, tone=0.68)
    wide, tall = (0, north - south, 0), (0, 0, high - low)
    inwards, outwards = (_REVEAL_M, 0, 0), (-_REVEAL_M, 0, 0)
    return [
        rectangle((-_REVEAL_M, south, low), wide, inwards, paint),
        rectangle((0, south, high), wide, outwards, paint),
        rectangle((0, south, low), tall, outwards, paint),
        rectangle((-_REVEAL_M, north, low), tall, inwards, paint),
    ]


def _door(west_m: float, east_m: float) -> list[Chart]:
    """Return a paneled door in its frame in the south wall."""
    frame, leaf = lacquered(0.7), wooden(0.34, 0.03)
    top = 2.05
    in_frame = ("south", "bottom", "east", "west", "top")
    charts = box((west_m, 0, 0), (east_m, 0.03, top), leaf, in_frame)
    for x in (west_m - 0.08, east_m):
        charts += box((x, 0, 0), (x + 0.08, 0.045, top + 0.08), frame, ("south", "bottom"))
    charts += box((west_m, 0, top), (east_m, 0.045, top + 0.08), frame, ("south", "east", "west"))
    half = 0.5 * (east_m - west_m)
    for x in (west_m + 0.10, west_m + half + 0.05):
        for low, high in ((0.15, 0.85), (1.0, 1.9)):
            charts += box((x, 0.03, low), (x + half - 0.15, 0.045, high), leaf, ("south",))
    handle = (west_m + 0.03, 0.03, 0.96)
    return charts + box(handle, (west_m + 0.07, 0.09, 1.0), lacquered(0.3), ("south",))
