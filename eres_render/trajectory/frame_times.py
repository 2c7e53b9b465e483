"""When to take the next frame: once the image has moved far enough."""

from __future__ import annotations

import functools
import logging
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from eres_render.camera import Camera, Plane, map_pixels, plane_homography
from eres_render.errors import RenderError
from eres_render.trajectory.spline import Trajectory

Float64 = NDArray[np.float64]

# Largest motion in the image, px at render resolution, from the first time to the second, in s.
ImageMotion = Callable[[float, float], float]

_log = logging.getLogger(__name__)

_FAR_APART_PX = 1.0
_TIME_RESOLUTION_S = 1e-9
_LONGEST_STRIDE_S = 1e-3  # no camera that moves like a body goes and returns within it


def plane_image_motion(
    trajectory: Trajectory, camera: Camera, plane: Plane, grid_points: int = 9
) -> ImageMotion:
    """Return the largest displacement over a grid of image points, as a plane induces it."""
    points_px = camera.grid(grid_points)

    def motion(t_0_s: float, t_1_s: float) -> float:
        T_0, T_1 = trajectory.pose([t_0_s, t_1_s])
        moved_px = map_pixels(plane_homography(camera.K, T_0, T_1, plane), points_px)
        return float(np.linalg.norm(moved_px - points_px, axis=-1).max())

    return motion


# 1 / z-depth, (N,) 1/m, from a (4, 4) pose at (N, 2) pixels; 0 where nothing is seen.
InverseDepth = Callable[[Float64, Float64], Float64]


def depth_image_motion(
    trajectory: Trajectory, camera: Camera, inverse_depth: InverseDepth, grid_points: int = 33
) -> ImageMotion:
    """Return the largest displacement over a grid of image points, each at its own depth.

    What is nearer than all else and falls between the grid's points, 1/32 of the image apart, moves
    farther than this says.
    """
    points_px = camera.grid(grid_points)
    rays = camera.rays(points_px)

    @functools.lru_cache(maxsize=1)  # many second times are tried for each first one
    def seen_at(t_s: float) -> tuple[Float64, Float64]:
        T = trajectory.pose(t_s)
        return T, inverse_depth(T, points_px)

    def motion(t_0_s: float, t_1_s: float) -> float:
        T_0, per_depth = seen_at(t_0_s)
        T = np.linalg.inv(trajectory.pose(t_1_s)) @ T_0
        # Points over their depth: what lies at infinity only turns.
        points = rays @ T[:3, :3].T + per_depth[:, None] * T[:3, 3]
        if not np.all(points[:, 2] > 0):
            return float(np.hypot(camera.width, camera.height))  # out of view, farther than any
        return float(np.linalg.norm(camera.project(points) - points_px, axis=-1).max())

    return motion


def adaptive_times(
    motion: ImageMotion, marks_s: Sequence[float], max_displacement_px: float
) -> NDArray[np.float64]:
    """Return frame times so close that the image moves at most so far from one to the next.

    From each frame the next is taken when the motion since reaches `max_displacement_px`, or at the
    next mark if that comes first.

    Parameters
    ----------
    motion
        Largest motion in the image between two times.
    marks_s
        Strictly increasing times, at least two, that must be frame times exactly; the first and the
        last bound the sequence.
    max_displacement_px
        In pixels at render resolution, positive.

    Returns
    -------
    t_s
        (T,) float64, strictly increasing, in seconds.
    """
    if not max_displacement_px > 0:
        raise RenderError(f"max_displacement_px must be positive, got {max_displacement_px}")
    if len(marks_s) < 2 or not np.all(np.diff(marks_s) > _TIME_RESOLUTION_S):
        raise RenderError(f"marks_s must be at least two increasing times, got {list(marks_s)}")

    times = [float(marks_s[0])]
    step_s = 1e-4
    for mark_s in map(float, marks_s[1:]):
        while (t := times[-1]) < mark_s:
            # Approach from below in short strides, so that motion that turns back is not missed.
            low, high = 0.0, min(0.5 * step_s, _LONGEST_STRIDE_S, mark_s - t)
            while motion(t, t + high) < max_displacement_px and t + high < mark_s:
                low, high = high, min(1.25 * high, high + _LONGEST_STRIDE_S, mark_s - t)
            if motion(t, t + high) > max_displacement_px:
                high = brentq(
                    lambda dt, t=t: motion(t, t + dt) - max_displacement_px, low, high, xtol=1e-9
                )
                step_s = high
            times.append(mark_s if mark_s - (t + high) < _TIME_RESOLUTION_S else t + high)
    return np.array(times)


def warn_if_far_apart(what: str, max_displacement_px: float) -> None:
    """Warn that events are missed where the image moves far from frame to frame."""
    if max_displacement_px > _FAR_APART_PX:
        _log.warning(
            "%s: frames lie up to %g px apart, expected at most %g (--max-displacement): what "
            "turns back in between makes no events, at 2 px about a fifth of them",
            *(what, max_displacement_px, _FAR_APART_PX),
        )
