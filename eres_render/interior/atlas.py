"""An atlas of charts on one texture: the layout, the mesh, the paint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.interior.uv_charts import Chart
from eres_render.textures.fractal_noise import Float32

CELL_M = 0.02
"""Size of a cell, m. Charts take up whole cells with one empty cell around them, so that no cell of
a lightmap of this size holds the light of two charts."""


@dataclass(frozen=True, slots=True)
class Place:
    """The cells of one chart, without the empty ones around it."""

    column: int
    row: int
    columns: int
    rows: int


@dataclass(frozen=True, slots=True)
class Atlas:
    """Charts with their places on a rectangle of `columns` x `rows` cells."""

    charts: Sequence[Chart]
    places: Sequence[Place]
    columns: int
    rows: int

    def paint(self, texels_per_cell: int, seed: int) -> Float32:
        """Return the texture, painted around each chart too, for filtered look-ups at the edge."""
        k = texels_per_cell
        texels = np.full((self.rows * k, self.columns * k), 0.5, dtype=np.float32)
        for i, (chart, at) in enumerate(zip(self.charts, self.places, strict=True)):
            shape = ((at.rows + 2) * k, (at.columns + 2) * k)
            painted = chart.paint(shape, CELL_M / k, np.random.default_rng([seed, i]))
            top, left = (at.row - 1) * k, (at.column - 1) * k
            texels[top : top + shape[0], left : left + shape[1]] = painted
        return np.clip(texels, 0.02, 0.9, out=texels)

    def ply(self) -> bytes:
        """Return the charts as one binary PLY mesh with normals and texture coordinates."""
        vertices, triangles, first = [], [], 0
        for chart, at in zip(self.charts, self.places, strict=True):
            rows, columns = chart.points.shape[:2]
            u = (at.column + chart.s * at.columns) / self.columns
            v = (at.row + chart.t * at.rows) / self.rows
            uv = np.stack(np.meshgrid(u, v), axis=-1)
            parts = (chart.points, chart.normals, uv)
            vertices.append(np.concatenate(parts, axis=-1).reshape(-1, 8))
            number = first + np.arange(rows * columns).reshape(rows, columns)
            a, b = number[:-1, :-1][chart.solid], number[:-1, 1:][chart.solid]
            c, d = number[1:, :-1][chart.solid], number[1:, 1:][chart.solid]
            triangles += [np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)]
            first += rows * columns
        return _ply(np.concatenate(vertices), np.concatenate(triangles))


def _ply(
    vertices: NDArray[np.float64],  # (N, 8) x y z nx ny nz u v
    triangles: NDArray[np.int64],  # (M, 3)
) -> bytes:
    """Return the bytes of a binary little-endian PLY."""
    names = ("x", "y", "z", "nx", "ny", "nz", "u", "v")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("index", "<i4", 3)])
    faces["count"], faces["index"] = 3, triangles
    text = "\n".join([*header, "end_header", ""])
    return text.encode() + vertices.astype("<f4").tobytes() + faces.tobytes()


def layout(charts: Sequence[Chart], columns: int) -> Atlas:
    """Place charts on shelves of a rectangle at least `columns` cells wide, tallest first."""
    sides = [tuple(max(1, round(side / CELL_M)) for side in chart.size_m) for chart in charts]
    columns = max(columns, max(width for width, _ in sides) + 2)
    places: dict[int, Place] = {}
    left, top, shelf = 0, 0, 0
    for i in sorted(range(len(charts)), key=lambda i: (-sides[i][1], -sides[i][0], i)):
        width, height = sides[i]
        if left + width + 2 > columns:
            left, top, shelf = 0, top + shelf, 0
        places[i] = Place(left + 1, top + 1, width, height)
        left, shelf = left + width + 2, max(shelf, height + 2)
    return Atlas(charts, [places[i] for i in range(len(charts))], columns, top + shelf)
