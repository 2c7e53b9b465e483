"""Surfaces as grids of points, each unrolled onto a rectangle of a texture.

Seen from the front, a chart's u runs to the right and its v downward.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.textures.fractal_noise import Float32

Float64 = NDArray[np.float64]

# Called with (rows, columns), texel_m and a generator; returns reflectances of that shape.
Painter = Callable[[tuple[int, int], float, np.random.Generator], Float32]
# Makes the painter of one face of a box; called with whether the box is longest along the face's u.
FacePainter = Callable[[bool], Painter]


@dataclass(frozen=True, eq=False)
class Chart:
    """A grid of points with a painter.

    `points`, m, and `normals`, of length 1 and out of the front, are (rows, columns, 3). `t`
    (rows,) and `s` (columns,) place the grid's lines on the rectangle, from 0 to 1. `size_m` is the
    rectangle's width and height. `solid` (rows - 1, columns - 1) is False at a hole.
    """

    points: Float64
    normals: Float64
    t: Float64
    s: Float64
    size_m: tuple[float, float]
    paint: Painter
    solid: NDArray[np.bool_]


def moved(charts: Iterable[Chart], turn_deg: float, shift_m: ArrayLike) -> list[Chart]:
    """Return charts turned about the z axis, then shifted by (3,) m."""
    turn_rad = np.deg2rad(turn_deg)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    shift_m = np.asarray(shift_m)
    return [
        replace(chart, points=chart.points @ R.T + shift_m, normals=chart.normals @ R.T)
        for chart in charts
    ]


def grid(points: ArrayLike, paint: Painter, t: ArrayLike, s: ArrayLike) -> Chart:
    """Return a curved, smoothly shaded chart through points; all arrays are as in `Chart`."""
    p = np.asarray(points, dtype=np.float64)
    along_v, along_u = np.gradient(p, axis=0), np.gradient(p, axis=1)
    normals = np.cross(along_v, along_u)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals = normals / np.maximum(length, 1e-12)
    width = np.linalg.norm(np.diff(p, axis=1), axis=-1).sum(axis=1).max()
    height = np.linalg.norm(np.diff(p, axis=0), axis=-1).sum(axis=0).max()
    solid = np.ones((p.shape[0] - 1, p.shape[1] - 1), dtype=bool)
    t, s = np.asarray(t, dtype=np.float64), np.asarray(s, dtype=np.float64)
    return Chart(p, normals, t, s, (float(width), float(height)), paint, solid)


def rectangle(corner: ArrayLike, right: ArrayLike, down: ArrayLike, paint: Painter) -> Chart:
    """Return a flat rectangular chart, by its corner at the top left and its sides, (3,) m each."""
    return plate(corner, right, down, paint, (0.0, 1.0), (0.0, 1.0))


def plate(
    corner: ArrayLike,
    right: ArrayLike,
    down: ArrayLike,
    paint: Painter,
    t: tuple[float, ...],
    s: tuple[float, ...],
    hole: tuple[int, int] | None = None,
) -> Chart:
    """Return a `rectangle` that is cut at `t` and `s` as in `Chart`, without the cell `hole`."""
    corner, right, down = (np.asarray(x, dtype=np.float64) for x in (corner, right, down))
    points = corner + np.multiply.outer(t, down)[:, None] + np.multiply.outer(s, right)
    normal = np.cross(down, right)
    normals = np.broadcast_to(normal / np.linalg.norm(normal), points.shape)
    solid = np.ones((len(t) - 1, len(s) - 1), dtype=bool)
    if hole is not None:
        solid[hole] = False
    size_m = (float(np.linalg.norm(right)), float(np.linalg.norm(down)))
    return Chart(points, normals, np.array(t), np.array(s), size_m, paint, solid)


# Which corner of a box each face starts from, and along which axes its u and v run from there.
_FACES = {
    "west": ((0, 1, 1), (1, -1), (2, -1)),
    "east": ((1, 0, 1), (1, 1), (2, -1)),
    "south": ((0, 0, 1), (0, 1), (2, -1)),
    "north": ((1, 1, 1), (0, -1), (2, -1)),
    "top": ((0, 1, 1), (0, 1), (1, -1)),
    "bottom": ((0, 0, 0), (0, 1), (1, 1)),
}


def box(
    low: ArrayLike, high: ArrayLike, paint: FacePainter, without: tuple[str, ...] = ()
) -> list[Chart]:
    """Return the faces of a box between two opposite corners, (3,) m."""
    return [face(name, low, high, paint) for name in _FACES if name not in without]


def face(name: str, low: ArrayLike, high: ArrayLike, paint: FacePainter) -> Chart:
    """Return a single face of a box between two opposite corners, (3,) m."""
    ends = np.array([low, high], dtype=np.float64)
    size = ends[1] - ends[0]
    corner, (u, u_sign), (v, v_sign) = _FACES[name]
    right, down = np.zeros(3), np.zeros(3)
    right[u], down[v] = u_sign * size[u], v_sign * size[v]
    start = ends[list(corner), [0, 1, 2]]
    return rectangle(start, right, down, paint(bool(size[u] >= size[v])))


def rounded_box(
    low: ArrayLike,
    high: ArrayLike,
    radius_m: float,
    paint: FacePainter,
    without: tuple[str, ...] = (),
) -> list[Chart]:
    """Return the faces of a `box` with round edges; each face has half of each of its edges."""
    ends = np.array([low, high], dtype=np.float64)
    size = ends[1] - ends[0]
    core = ends + radius_m * np.array([[1.0], [-1.0]])
    charts = []
    bend = radius_m * np.linspace(0, 1, 5)
    for name, (corner, (u, u_sign), (v, v_sign)) in _FACES.items():
        if name in without:
            continue
        s_m = np.unique(np.concatenate([bend, size[u] - bend]))
        t_m = np.unique(np.concatenate([bend, size[v] - bend]))
        cube = np.tile(ends[list(corner), [0, 1, 2]], (len(t_m), len(s_m), 1))
        cube[..., u] += u_sign * s_m
        cube[..., v] += v_sign * t_m[:, None]
        inner = np.clip(cube, core[0], core[1])
        out = cube - inner
        out /= np.linalg.norm(out, axis=-1, keepdims=True)
        chart = grid(
            inner + radius_m * out, paint(bool(size[u] >= size[v])), t_m / size[v], s_m / size[u]
        )
        charts.append(replace(chart, normals=out))
    return charts


def lathe(radii_m: ArrayLike, heights_m: ArrayLike, paint: Painter, segments: int = 32) -> Chart:
    """Return the surface of revolution about z of a profile from top to bottom, (N,) m."""
    r, z = np.asarray(radii_m, dtype=np.float64), np.asarray(heights_m, dtype=np.float64)
    angle = np.linspace(0, 2 * np.pi, segments + 1)

    def turned(out: Float64, up: Float64) -> Float64:
        around = np.outer(out, np.cos(angle)), np.outer(out, np.sin(angle))
        return np.stack([*around, np.repeat(up[:, None], segments + 1, axis=1)], axis=-1)

    points = turned(r, z)
    along = np.concatenate([[0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
    chart = grid(points, paint, along / along[-1], angle / (2 * np.pi))
    # One-sided differences at the seam would show there.
    slope_r, slope_z = np.gradient(r), np.gradient(z)
    length = np.hypot(slope_r, slope_z)
    return replace(chart, normals=turned(-slope_z / length, slope_r / length))


def both_sides(chart: Chart, apart_m: float = 0.002) -> list[Chart]:
    """Return the two sides of a thin sheet, `chart` as its front and a back `apart_m` behind."""
    back = replace(
        chart,
        points=(chart.points - apart_m * chart.normals)[:, ::-1],
        normals=-chart.normals[:, ::-1],
        s=1 - chart.s[::-1],
        solid=chart.solid[:, ::-1],
    )
    return [chart, back]
