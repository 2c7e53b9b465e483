"""Decoration: pictures, curtains, lamps, a plant, things on tables."""

from __future__ import annotations

from functools import partial

import numpy as np

from eres_render.interior import shell
from eres_render.interior.paints import everywhere, glazed, lacquered, wooden
from eres_render.interior.uv_charts import Chart, Painter, both_sides, box, face, grid, lathe, moved
from eres_render.textures import printed
from eres_render.textures.cloth import striped
from eres_render.textures.nature import earth, leaf, peel


def _picture(width_m: float, height_m: float, paint: Painter, frame_tone: float) -> list[Chart]:
    """Return a framed picture on the south side of the plane y = 0, centered on the origin."""
    x, z, edge = 0.5 * width_m, 0.5 * height_m, 0.04
    frame = wooden(frame_tone)
    charts = [face("south", (-x, -0.012, -z), (x, 0, z), everywhere(paint))]
    for low, high in (
        ((-x - edge, z), (x + edge, z + edge)),
        ((-x - edge, -z - edge), (x + edge, -z)),
    ):
        charts += box((low[0], -0.035, low[1]), (high[0], 0, high[1]), frame, ("north",))
    for left in (-x - edge, x):
        charts += box((left, -0.035, -z), (left + edge, 0, z), frame, ("north", "top", "bottom"))
    return charts


def pictures() -> list[Chart]:
    """Return the pictures on three walls."""
    charts = moved(_picture(0.9, 0.65, printed.landscape, 0.15), 0, (1.35, shell.NORTH_M, 1.6))
    charts += moved(_picture(0.5, 0.7, printed.poster, 0.08), 0, (2.45, shell.NORTH_M, 1.6))
    charts += moved(_picture(0.45, 0.45, printed.abstract, 0.5), 0, (3.25, shell.NORTH_M, 1.75))
    charts += moved(_picture(1.3, 0.8, printed.landscape, 0.4), 180, (2.55, 0, 1.55))
    charts += moved(_picture(0.5, 0.65, printed.text_page, 0.1), 180, (1.15, 0, 1.6))
    charts += moved(_picture(0.8, 0.8, printed.abstract, 0.12), -90, (shell.EAST_M, 2.4, 1.55))
    charts += moved(_picture(0.4, 0.55, printed.landscape, 0.55), -90, (shell.EAST_M, 1.55, 1.65))
    charts += moved(_picture(0.55, 0.75, printed.poster, 0.1), -90, (shell.EAST_M, 4.05, 1.55))
    return charts


def curtains() -> list[Chart]:
    """Return two striped curtains in folds and their rail."""
    charts = []
    top, low = shell.WINDOW_HIGH_M + 0.12, 0.06
    for middle in (shell.WINDOW_SOUTH_M - 0.1, shell.WINDOW_NORTH_M + 0.1):
        s = np.linspace(0, 1, 97)
        t = np.linspace(0, 1, 9)
        y = middle + 0.62 * (s - 0.5) * (1 - 0.12 * np.sin(np.pi * t))[:, None]
        fold = 0.035 * np.sin(2 * np.pi * 6.5 * s + 0.5 * t[:, None]) * (0.5 + 0.5 * t[:, None])
        z = np.broadcast_to((top - (top - low) * t)[:, None], y.shape)
        points = np.stack([0.16 + fold, y, z], axis=-1)
        paint = partial(striped, tones=(0.62, 0.5, 0.62, 0.2), period_m=0.16)
        charts += both_sides(grid(points, paint, t, s))
    rail = (0.14, shell.WINDOW_SOUTH_M - 0.5, top), (0.17, shell.WINDOW_NORTH_M + 0.5, top + 0.03)
    return charts + box(*rail, wooden(0.12))


def floor_lamp() -> list[Chart]:
    """Return a floor lamp, not lit, in the south-western corner."""
    shade = lathe((0.13, 0.24), (1.62, 1.30), partial(striped, tones=(0.6, 0.45)))
    inner = lathe((0.237, 0.127), (1.30, 1.62), partial(striped, tones=(0.7, 0.65)))
    rod = (0.014, 0.014, 0.05, 0.16, 0.17, 0.17)
    pole = lathe(rod, (1.6, 0.06, 0.045, 0.03, 0.02, 0.0), wooden(0.12)(False))
    return moved([shade, inner, pole], 0, (0.62, 0.55, 0))


def plant() -> list[Chart]:
    """Return a tall plant in a pot, in the south-eastern corner."""
    rng = np.random.default_rng(5)
    rim = (0.155, 0.175, 0.185, 0.185, 0.15, 0.13)
    charts = [lathe(rim, (0.36, 0.36, 0.355, 0.32, 0.05, 0.0), glazed(0.35))]
    charts.append(lathe((0.155, 0.155), (0.33, 0.36), glazed(0.25)))
    charts.append(lathe((0.002, 0.156), (0.335, 0.33), earth))
    for k in range(5):
        base = np.array([0.05 * np.cos(1.3 * k), 0.05 * np.sin(1.3 * k), 0.33])
        lean = np.array([np.cos(1.3 * k), np.sin(1.3 * k), 0]) * rng.uniform(0.10, 0.22)
        height = rng.uniform(0.55, 1.05)
        tip = base + lean + [0, 0, height]
        charts.append(_stem(base, tip))
        for j in range(9):
            share = 0.35 + 0.65 * (j + 1) / 9
            at = base + share * (tip - base)
            heading = 2.4 * j + 1.1 * k + rng.uniform(-0.3, 0.3)
            size = rng.uniform(0.24, 0.36) * (1.15 - 0.35 * share)
            charts += moved(_leaf(size, rng.uniform(0.15, 0.85)), np.rad2deg(heading), at)
    return moved(charts, 0, (5.82, 0.6, 0))


def _stem(base: np.ndarray, tip: np.ndarray) -> Chart:
    angle = np.linspace(0, 2 * np.pi, 9)
    along = np.linspace(1, 0, 4)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(9)], axis=-1)
    points = (base + along[:, None] * (tip - base))[:, None] + 0.008 * ring
    return grid(points, wooden(0.14)(False), np.linspace(0, 1, 4), angle / (2 * np.pi))


def _leaf(length_m: float, rise: float) -> list[Chart]:
    """Return a leaf that starts at the origin along x, rises, and bends down."""
    t, s = np.linspace(0, 1, 9), np.linspace(0, 1, 5)
    half = 0.20 * length_m * np.sin(np.pi * (0.02 + 0.96 * t)) ** 0.8
    side = half[:, None] * (1 - 2 * s)
    x = np.repeat(length_m * t[:, None], 5, axis=1)
    z = length_m * (rise * t - 0.75 * t**2)[:, None] + 0.35 * np.abs(side)
    points = np.stack([x, side, z], axis=-1)
    return both_sides(grid(points[:, ::-1], leaf, t, s), apart_m=0.0015)


# Centers of the ceiling lamps, x and y; scene.xml has the glowing rectangle 5 mm below each.
_CEILING_LAMPS_M = ((3.15, 1.2), (4.75, 3.3))


def lamps() -> list[Chart]:
    """Return the housings of two ceiling lamps, and a lamp over the table, not lit."""
    charts = []
    for x, y in _CEILING_LAMPS_M:
        low, high = (x - 0.6, y - 0.25, shell.HEIGHT_M - 0.05), (x + 0.6, y + 0.25, shell.HEIGHT_M)
        charts += box(low, high, lacquered(0.6), ("bottom", "top"))
    x, y = 2.0, 3.75
    charts += box((x - 0.6, y - 0.12, 1.95), (x + 0.6, y + 0.12, 2.0), lacquered(0.6))
    for dx in (-0.5, 0.5):
        low, high = (x + dx - 0.004, y - 0.004, 2.0), (x + dx + 0.004, y + 0.004, shell.HEIGHT_M)
        charts += box(low, high, lacquered(0.1), ("bottom", "top"))
    return charts


def things() -> list[Chart]:
    """Return the things on the tables, the sideboard and the sill."""
    table, sideboard, low = 0.75, 0.76, 0.412
    charts = moved(_bowl_of_fruit(), 0, (2.15, 3.72, table))
    charts += moved(_mug(0.5), 40, (1.55, 3.5, table))
    charts += moved(_mug(0.15), 200, (2.5, 4.0, table))
    charts += moved(_paper(0.30, 0.42), 20, (1.72, 3.52, table))
    charts += moved(_paper(0.21, 0.30), -33, (2.55, 3.58, table))
    charts += moved(_pile_of_books(4, 1), 8, (1.55, 3.95, table))
    charts += moved(_pile_of_books(3, 2), -20, (3.8, 2.42, low))
    charts += moved(_paper(0.42, 0.30), 30, (4.15, 2.55, low))
    charts += moved(_mug(0.6), 0, (4.3, 2.42, low))
    charts += moved(_vase(), 0, (6.12, 2.65, sideboard))
    charts += moved(_pile_of_books(5, 3), -80, (6.15, 2.1, sideboard))
    charts += moved(_bowl_of_fruit(), 50, (6.15, 1.45, sideboard))
    charts += moved(_pile_of_books(2, 4), 70, (0.75, 2.6, 0.44))
    return charts


def _bowl_of_fruit() -> list[Chart]:
    outside = lathe((0.15, 0.145, 0.10, 0.055, 0.055), (0.09, 0.07, 0.025, 0.008, 0), glazed(0.45))
    inside = lathe((0.002, 0.06, 0.10, 0.15), (0.02, 0.022, 0.04, 0.09), glazed(0.6))
    charts = [outside, inside]
    spots = ((0.055, 0, 0.065), (-0.04, 0.045, 0.065), (-0.03, -0.055, 0.065), (0.005, 0.0, 0.125))
    t = np.linspace(0.02, np.pi - 0.02, 15)
    for k, at in enumerate(spots):
        ball = lathe(0.042 * np.sin(t), 0.042 * np.cos(t), partial(peel, tone=0.25 + 0.1 * k), 24)
        charts += moved([ball], 70 * k, at)
    return charts


def _mug(tone: float) -> list[Chart]:
    outside = lathe((0.037, 0.040, 0.040, 0.038), (0.095, 0.095, 0.01, 0), glazed(tone))
    inside = lathe((0.002, 0.036, 0.037), (0.02, 0.02, 0.095), glazed(0.6))
    return [outside, inside]


def _vase() -> list[Chart]:
    radii = (0.045, 0.05, 0.04, 0.05, 0.09, 0.11, 0.10, 0.065, 0.06)
    heights = (0.36, 0.355, 0.31, 0.27, 0.20, 0.13, 0.07, 0.01, 0)
    return [
        lathe(radii, heights, glazed(0.3), 48),
        lathe((0.036, 0.045), (0.25, 0.36), glazed(0.2)),
        lathe((0.002, 0.036), (0.251, 0.25), glazed(0.1)),
    ]


def _paper(width_m: float, height_m: float) -> list[Chart]:
    low, high = (-0.5 * width_m, -0.5 * height_m, 0), (0.5 * width_m, 0.5 * height_m, 0.003)
    return [face("top", low, high, everywhere(printed.text_page))]


def _pile_of_books(count: int, seed: int) -> list[Chart]:
    rng = np.random.default_rng(seed)
    charts: list[Chart] = []
    edges = ("east", "south", "north")
    z, width, depth = 0.0, 0.24, 0.32
    for _ in range(count):
        thick = rng.uniform(0.025, 0.05)
        low, high = (-0.5 * width, -0.5 * depth, z), (0.5 * width, 0.5 * depth, z + thick)
        paints = {"west": printed.book_spine} | dict.fromkeys(edges, printed.book_pages)
        paints["top"] = printed.book_cover
        book = [face(name, low, high, everywhere(paint)) for name, paint in paints.items()]
        charts += moved(book, rng.uniform(-14, 14), (0, 0, 0))
        z += thick
        width, depth = 0.93 * width, 0.93 * depth
    return charts
