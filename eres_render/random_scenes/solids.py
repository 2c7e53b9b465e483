"""Random solids about the origin: boxes, panels, turned bodies, rocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render.interior import uv_charts
from eres_render.interior.uv_charts import Chart, FacePainter

Float64 = NDArray[np.float64]

_RINGS, _SEGMENTS = 16, 28  # of turned bodies and rocks
_POLE_RAD = 1e-3  # where their rings end, so that no cell of the grid is empty
_WAVES = 5  # that deform a rock


def random_solid(
    radius_m: float, paint: FacePainter, rng: np.random.Generator
) -> tuple[Chart, ...]:
    """Return a random solid, fronts outside, within a sphere about the origin, turned at random."""
    charts = SOLIDS[rng.integers(len(SOLIDS))](paint, rng)
    reach = max(float(np.linalg.norm(chart.points, axis=-1).max()) for chart in charts)
    R = Rotation.random(random_state=rng).as_matrix()
    scale = radius_m / reach
    return tuple(_placed(chart, scale, R) for chart in charts)


def _placed(chart: Chart, scale: float, R: Float64) -> Chart:
    width_m, height_m = chart.size_m
    return replace(
        chart,
        points=scale * chart.points @ R.T,
        normals=chart.normals @ R.T,
        size_m=(scale * width_m, scale * height_m),
    )


def room(half_m: Float64, paint: FacePainter) -> list[Chart]:
    """Return the inside of a box with the lower and the upper corner `half_m`, (2, 3)."""
    return [
        uv_charts.both_sides(chart, 0.0)[1] for chart in uv_charts.box(half_m[0], half_m[1], paint)
    ]


def _box(paint: FacePainter, rng: np.random.Generator) -> list[Chart]:
    half = rng.uniform(0.3, 1.0, 3)
    return uv_charts.box(-half, half, paint)


def _panel(paint: FacePainter, rng: np.random.Generator) -> list[Chart]:
    half = np.array([rng.uniform(0.4, 1.0), 0.01, rng.uniform(0.4, 1.0)])
    return uv_charts.box(-half, half, paint)


def _rounded_box(paint: FacePainter, rng: np.random.Generator) -> list[Chart]:
    half = rng.uniform(0.4, 1.0, 3)
    return uv_charts.rounded_box(-half, half, float(rng.uniform(0.1, 0.35)), paint)


def _turned(paint: FacePainter, rng: np.random.Generator) -> list[Chart]:
    """Return a body of revolution: an ellipsoid with grooves and bulges."""
    angle = np.linspace(_POLE_RAD, np.pi - _POLE_RAD, _RINGS + 1)
    amplitude, phase = rng.uniform(-0.15, 0.15, 3), rng.uniform(0, 2 * np.pi, 3)
    waves = np.sin(np.outer(angle, np.arange(2, 5)) + phase) @ amplitude
    radii = np.sin(angle) * (1 + waves) * rng.uniform(0.4, 1.0)
    return [uv_charts.lathe(radii, np.cos(angle), paint(True), _SEGMENTS)]


def _rock(paint: FacePainter, rng: np.random.Generator) -> list[Chart]:
    """Return a sphere deformed by waves of random directions."""
    angle = np.linspace(_POLE_RAD, np.pi - _POLE_RAD, _RINGS + 1)
    ball = uv_charts.lathe(np.sin(angle), np.cos(angle), paint(True), _SEGMENTS)
    waves, phase = rng.normal(0, 2.0, (3, _WAVES)), rng.uniform(0, 2 * np.pi, _WAVES)
    depth = np.sin(ball.points @ waves + phase) @ rng.uniform(0.0, 0.12, _WAVES)
    points = ball.points * (1 + depth[..., None]) * rng.uniform(0.6, 1.0, 3)
    return [uv_charts.grid(points, ball.paint, ball.t, ball.s)]


_Maker = Callable[[FacePainter, np.random.Generator], list[Chart]]
SOLIDS: tuple[_Maker, ...] = (_box, _panel, _rounded_box, _turned, _rock)
"""Makers of solids of any size about the origin."""
