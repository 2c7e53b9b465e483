"""Furniture: table, chairs, sofa, bookcase, sideboard, rug."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from eres_render.interior.paints import cushion, everywhere, lacquered, upholstered, wooden
from eres_render.interior.shell import EAST_M, NORTH_M
from eres_render.interior.uv_charts import Chart, box, face, grid, moved, rectangle, rounded_box
from eres_render.textures.cloth import kilim, striped
from eres_render.textures.printed import book_cover, book_pages, book_spine


def _legs(
    width_m: float, depth_m: float, height_m: float, thick_m: float, tone: float
) -> list[Chart]:
    """Return four legs under the corners of a rectangle about the origin."""
    charts = []
    x, y = 0.5 * (width_m - thick_m), 0.5 * (depth_m - thick_m)
    for cx, cy in ((-x, -y), (x, -y), (x, y), (-x, y)):
        low = (cx - 0.5 * thick_m, cy - 0.5 * thick_m, 0)
        high = (cx + 0.5 * thick_m, cy + 0.5 * thick_m, height_m)
        charts += box(low, high, wooden(tone), ("top", "bottom"))
    return charts


def table() -> list[Chart]:
    """Return the dining table."""
    top = box((-0.8, -0.45, 0.715), (0.8, 0.45, 0.75), wooden(0.36, 0.022))
    apron = box((-0.70, -0.36, 0.63), (0.70, 0.36, 0.715), wooden(0.3), ("top",))
    return moved(top + apron + _legs(1.5, 0.8, 0.715, 0.07, 0.3), 0, (2.0, 3.75, 0))


def coffee_table() -> list[Chart]:
    """Return a low table on the rug."""
    top = rounded_box((-0.5, -0.3, 0.36), (0.5, 0.3, 0.40), 0.015, wooden(0.2))
    shelf = box((-0.42, -0.24, 0.14), (0.42, 0.24, 0.16), wooden(0.2))
    return moved(top + shelf + _legs(0.9, 0.52, 0.365, 0.05, 0.17), 12, (4.0, 2.5, 0.012))


def _chair() -> list[Chart]:
    """Return a chair at the origin that faces north."""
    wood = wooden(0.27)
    charts = rounded_box((-0.22, -0.22, 0.43), (0.22, 0.22, 0.475), 0.018, upholstered(0.22))
    charts += _legs(0.42, 0.42, 0.432, 0.04, 0.27)
    for x in (-0.20, 0.20):
        charts += box((x - 0.018, -0.22, 0.47), (x + 0.018, -0.185, 0.95), wood, ("bottom",))
    for z in (0.60, 0.72, 0.84):
        charts += box((-0.182, -0.212, z), (0.182, -0.193, z + 0.07), wood, ("east", "west"))
    for y in (-0.19, 0.19):
        charts += box((-0.17, y - 0.012, 0.2), (0.17, y + 0.012, 0.23), wood, ("east", "west"))
    return charts


def chairs() -> list[Chart]:
    """Return four chairs around the table, each slightly turned."""
    places = (
        (4, (1.55, 3.08, 0)),
        (-7, (2.45, 3.02, 0)),
        (96, (3.15, 3.80, 0)),
        (187, (1.9, 4.52, 0)),
    )
    return [chart for turn, at in places for chart in moved(_chair(), turn, at)]


def sofa() -> list[Chart]:
    """Return a sofa with its back to the south wall, and its cushions."""
    cloth = upholstered(0.20)
    charts = rounded_box((0, 0.06, 0.08), (2.1, 0.92, 0.34), 0.04, cloth)
    charts += rounded_box((0.14, 0.05, 0.30), (1.96, 0.27, 0.82), 0.07, cloth, ("bottom", "south"))
    for x in (0, 1.92):
        charts += rounded_box((x, 0.05, 0.30), (x + 0.18, 0.90, 0.62), 0.06, cloth, ("bottom",))
    for x in (0.20, 1.06):
        charts += rounded_box((x, 0.26, 0.32), (x + 0.84, 0.94, 0.48), 0.06, cloth, ("bottom",))
    for x in (0.06, 1.98):
        for y in (0.12, 0.82):
            low, high = (x, y, 0), (x + 0.06, y + 0.06, 0.09)
            charts += box(low, high, wooden(0.1), ("top", "bottom"))
    for x, turn, tones in ((0.48, 14, (0.65, 0.1, 0.35)), (1.62, -11, (0.12, 0.5, 0.12, 0.7))):
        charts += moved(_pillow(tones), turn, (x, 0.40, 0.68))
    return moved(charts, 0, (1.5, 0.02, 0))


def _pillow(tones: tuple[float, ...]) -> list[Chart]:
    """Return a square pillow about the origin that leans on something in the south."""
    s = np.linspace(0, 1, 13)
    x, z = np.meshgrid(0.44 * (s - 0.5), 0.44 * (0.5 - s))
    bulge = 0.085 * ((1 - (2 * s - 1) ** 4)[:, None] * (1 - (2 * s - 1) ** 4)) ** 0.5
    lean = np.deg2rad(18)
    charts = []
    for side in (1, -1):
        y = side * bulge
        points = np.stack(
            [-side * x, y * np.cos(lean) - z * np.sin(lean), z * np.cos(lean) + y * np.sin(lean)],
            axis=-1,
        )
        charts.append(grid(points, partial(striped, tones=tones), s, s))
    return charts


def rug() -> list[Chart]:
    """Return a slightly turned kilim."""
    low, high = (-1.25, -0.85, 0), (1.25, 0.85, 0.012)
    return moved(box(low, high, lambda _: kilim, ("bottom",)), 4, (4.0, 2.45, 0))


# The bookcase: its width, depth and height, how thick its boards are; where it stands; its shelves.
_CASE = (1.8, 0.30, 2.05, 0.022)
_CASE_AT = (3.9, NORTH_M - 0.30, 0.0)
_SHELVES_M = (0.09, 0.50, 0.88, 1.26, 1.64, 2.05)


def bookcase() -> list[Chart]:
    """Return an open bookcase against the north wall."""
    width, depth, height, board = _CASE
    oak = wooden(0.33)
    charts = []
    for x in (0, 0.5 * (width - board), width - board):
        charts += box((x, 0, 0), (x + board, depth, height), oak, ("bottom", "north", "top"))
    for z in _SHELVES_M:
        without = ("east", "west", "north", *(("top",) if z == height else ()))
        for x in (board, 0.5 * (width + board)):
            low, high = (x, 0.008, z - board), (x + 0.5 * width - 1.5 * board, depth, z)
            charts += box(low, high, oak, without)
    charts.append(
        rectangle((0, depth - 0.004, height), (width, 0, 0), (0, 0, -height), wooden(0.26)(False))
    )
    charts += box((-0.02, -0.02, height), (width + 0.02, depth, height + 0.03), oak, ("north",))
    return moved(charts, 0, _CASE_AT)


def books() -> list[Chart]:
    """Return the books, shelf by shelf, with some gaps and some books that lie flat."""
    width, depth, _, board = _CASE
    rng = np.random.default_rng(11)
    charts: list[Chart] = []
    for shelf, z in enumerate(_SHELVES_M[:-1]):
        room = _SHELVES_M[shelf + 1] - z - board
        for left, right in ((board, 0.5 * (width - board)), (0.5 * (width + board), width - board)):
            charts += _row_of_books(left + 0.004, right - 0.02, z, room, depth, rng)
    return moved(charts, 0, _CASE_AT)


class _Book(NamedTuple):
    left: float
    thick: float
    high: float
    deep: float


def _row_of_books(
    left: float, right: float, z: float, room: float, depth: float, rng: np.random.Generator
) -> list[Chart]:
    row: list[_Book] = []
    x = left
    stop = right - rng.uniform(0.0, 0.22)
    series = (0.0, 0.0, 0.0)
    left_in_series = 0
    while True:
        if left_in_series == 0:
            series = (rng.uniform(0.025, 0.06), rng.uniform(0.62, 0.94), rng.uniform(0.15, 0.22))
            left_in_series = int(rng.integers(1, 5))
        thick, share, deep = series
        if x + thick > stop:
            break
        row.append(_Book(x, thick, share * room, deep))
        x += thick + 0.001
        left_in_series -= 1
    charts: list[Chart] = []
    back = depth - 0.03
    for k, book in enumerate(row):
        low = (book.left, back - book.deep, z)
        high = (book.left + book.thick, back, z + book.high)
        # Covers show only next to a gap or a smaller book.
        next_to = {"west": row[k - 1 : k], "east": row[k + 1 : k + 2]}
        paints = {"south": book_spine, "top": book_pages, "west": book_cover, "east": book_cover}
        for name, paint in paints.items():
            if any(b.high >= book.high and b.deep >= book.deep for b in next_to.get(name, ())):
                continue
            if name == "west" and k == 0:
                continue  # leans on the bookcase
            charts.append(face(name, low, high, everywhere(paint)))
    return charts


def sideboard() -> list[Chart]:
    """Return a sideboard against the brick wall: three doors, three drawers."""
    wood, front = wooden(0.24, 0.025), wooden(0.30, 0.03)
    charts = box((0, 0, 0.12), (1.8, 0.45, 0.76), wood, ("north",))
    for k in range(3):
        x = 0.03 + 0.585 * k
        charts += box((x, -0.018, 0.15), (x + 0.57, 0, 0.53), front, ("north",))
        charts += box((x, -0.018, 0.55), (x + 0.57, 0, 0.73), front, ("north",))
        for z in (0.47, 0.64):
            knob = (x + 0.265, -0.045, z), (x + 0.305, -0.018, z + 0.04)
            charts += box(*knob, lacquered(0.55), ("north",))
    charts += moved(_legs(1.7, 0.40, 0.12, 0.05, 0.18), 0, (0.9, 0.225, 0))
    return moved(charts, -90, (EAST_M - 0.45, 2.9, 0))


def stool() -> list[Chart]:
    """Return an upholstered stool between rug and window."""
    charts = rounded_box((-0.24, -0.24, 0.30), (0.24, 0.24, 0.44), 0.05, cushion(0.5, 0.15, 0.3))
    return moved(charts + _legs(0.40, 0.40, 0.32, 0.045, 0.2), 25, (0.75, 2.6, 0))
