"""Frame times: the next frame is due when the image has moved far enough."""

from __future__ import annotations

import functools
import itertools
import logging
import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from eres_render.camera import Camera, Plane, map_pixels, plane_homography
from eres_render.errors import RenderError, check_positive
from eres_render.trajectory.spline import Trajectory

Float64 = NDArray[np.float64]

# Largest motion in the image, px at render resolution, between two times in s.
ImageMotion = Callable[[float, float], float]
# Frame times for an image motion, marks in s that are among them, and the largest motion, px.
FrameTimes = Callable[[ImageMotion, Sequence[float], float], Float64]

_log = logging.getLogger(__name__)

_FAR_APART_PX = 1.0
_TIME_RESOLUTION_S = 1e-9
_MIN_STEP_S = 1e-7  # shorter ones would not be exact to a percent
_MAX_STRIDE_S = 1e-3  # a camera does not go and return within it
_PACE_S = 4e-3  # time between measurements of speed
_INSTANT_S = 1e-5  # in which it is measured
_POINTS_A_SIDE = 5  # of a box
_MAX_PAST = 1.05  # of the limit, where the search ends at a root
_RECENT = 8  # times whose poses and motions are kept


class Path(Protocol):
    """A camera's path: here only its poses are needed."""

    def pose(self, t_s: ArrayLike, /) -> Float64: ...


class RecentPoses:
    """A path that keeps its poses at the last few times, for several `ImageMotion` at once.

    Parameters
    ----------
    path
        The path.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._recent = functools.lru_cache(maxsize=_RECENT)(path.pose)

    def pose(self, t_s: ArrayLike) -> Float64:
        """Return the pose (4, 4) at a time, or the poses at several times; do not change them."""
        return self._recent(t_s) if isinstance(t_s, float) else self._path.pose(t_s)


def plane_image_motion(
    trajectory: Trajectory, camera: Camera, plane: Plane, grid_points: int = 9
) -> ImageMotion:
    """Return how far a plane's image moves, measured on a grid of image points.

    Parameters
    ----------
    trajectory
        The camera's path.
    camera
        The camera of the render.
    plane
        The plane that fills the camera's view.
    grid_points
        Points of the grid along each side of the image.

    Returns
    -------
    motion
        Largest displacement over the grid between two times, px.
    """
    points_px = camera.grid(grid_points)
    pinhole_px = camera.undistort(points_px)

    def motion(t_0_s: float, t_1_s: float) -> float:
        T_0, T_1 = trajectory.pose([t_0_s, t_1_s])
        H = plane_homography(camera.K, T_0, T_1, plane)
        moved_px = camera.distort(map_pixels(H, pinhole_px))
        return float(np.linalg.norm(moved_px - points_px, axis=-1).max())

    return motion


# 1 / z-depth, (N,) 1/m, from a (4, 4) pose at (N, 2) pixels; 0 where nothing is seen.
InverseDepth = Callable[[Float64, Float64], Float64]


def depth_image_motion(
    trajectory: Path, camera: Camera, inverse_depth: InverseDepth, grid_points: int = 33
) -> ImageMotion:
    """Return how far the image of a scene with depth moves, measured on a grid of image points.

    A near object between the grid points, which are 1/32 of the image apart, can move farther.

    Parameters
    ----------
    trajectory
        The camera's path.
    camera
        The camera of the render.
    inverse_depth
        Returns 1 / z-depth at pixels seen from a pose.
    grid_points
        Points of the grid along each side of the image.

    Returns
    -------
    motion
        Largest displacement over the grid between two times, px.
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
        # Points over their depth, so that points at infinity only turn.
        points = rays @ T[:3, :3].T + per_depth[:, None] * T[:3, 3]
        if not np.all(points[:, 2] > 0):
            return float(np.hypot(camera.width, camera.height))  # it leaves the view
        return float(np.linalg.norm(camera.project(points) - points_px, axis=-1).max())

    return motion


# T_world_object, (..., 4, 4), at times (...) in seconds.
Pose = Callable[[ArrayLike], Float64]
# Distance from a (3,) origin along (N, 3) rays to the first surface: (N,) in units of each ray's
# length, inf where there is none.
Distance = Callable[[Float64, Float64], Float64]


def object_image_motion(
    trajectory: Path,
    camera: Camera,
    pose: Pose,
    box_m: Float64,
    distance: Distance,
    unseen: ImageMotion | None = None,
    grid_points: int = 17,
) -> ImageMotion:
    """Return how far the image of a moving object moves.

    It is measured on a grid of image points that the object's box covers at the first time, or at
    the second if the object is out of view at the first. So an object that flies into the view
    counts as soon as it is there. If the box is in view but all grid points miss the object, such
    as two small balls far apart, the corners of the box count. Occlusion is ignored.

    Parameters
    ----------
    trajectory
        The camera's path.
    camera
        The camera of the render.
    pose
        The object's path, on the time axis of the camera's.
    box_m
        (2, 3) lower and upper corner of the object in its own coordinates, m.
    distance
        Returns the distance to the object along rays in its own coordinates.
    unseen
        Motion while the object is out of view, such as `shadow_image_motion`; 0 by default.
    grid_points
        Points of the grid along each side of the box's image.

    Returns
    -------
    motion
        Largest displacement over the grid between two times, px.
    """
    # Through a lens the box has curved edges, which reach farther than its corners.
    count = 2 if camera.distortion is None else _POINTS_A_SIDE
    sides = [np.linspace(low, high, count) for low, high in box_m.T]
    corners = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 3)
    size: Float64 = np.array([camera.width, camera.height], np.float64)

    @functools.lru_cache(maxsize=_RECENT)
    def T_cam_object(t_s: float) -> Float64:
        return np.linalg.inv(trajectory.pose(t_s)) @ pose(t_s)

    def in_camera(T: Float64, points: Float64) -> Float64:
        return points @ T[:3, :3].T + T[:3, 3]

    @functools.lru_cache(maxsize=2)
    def seen_at(t_s: float) -> Float64:
        """Return points of the object, (N, 3) in its own coordinates; none out of view."""
        T = T_cam_object(t_s)
        box = in_camera(T, corners)
        if not np.any(box[:, 2] > 0):
            return np.empty((0, 3))
        low: Float64 = np.zeros(2)
        high = size
        if np.all(box[:, 2] > 0):
            projected = camera.project(box)
            low, high = np.clip(projected.min(0), 0, size), np.clip(projected.max(0), 0, size)
        if not np.all(high > low):
            return np.empty((0, 3))
        x, y = np.meshgrid(*np.linspace(low, high, grid_points).T)
        grid = np.column_stack([x.ravel(), y.ravel()])
        T_object_cam = np.linalg.inv(pose(t_s)) @ trajectory.pose(t_s)
        rays = camera.rays(grid) @ T_object_cam[:3, :3].T
        reach = distance(T_object_cam[:3, 3], rays)
        met = np.isfinite(reach)
        if not met.any():
            return corners if np.all(box[:, 2] > 0) else np.empty((0, 3))
        return T_object_cam[:3, 3] + reach[met, None] * rays[met]

    def motion(t_0_s: float, t_1_s: float) -> float:
        points = seen_at(t_0_s)
        if not len(points):
            points = seen_at(t_1_s)
        if not len(points):
            return 0.0 if unseen is None else unseen(t_0_s, t_1_s)
        before, after = (in_camera(T_cam_object(t), points) for t in (t_0_s, t_1_s))
        if not np.all([before[:, 2] > 0, after[:, 2] > 0]):
            return float(np.hypot(*size))  # it leaves the view
        moved = camera.project(after) - camera.project(before)
        return float(np.linalg.norm(moved, axis=-1).max())

    return motion


def shadow_image_motion(
    pose: Pose, box_m: Float64, px_per_m: Callable[[float], float]
) -> ImageMotion:
    """Return how far the shadow or reflected light of an object out of view moves.

    Both count as if they moved as far as the object, on the nearest surface in view. If the object
    is near a lamp, they can move farther.

    Parameters
    ----------
    pose, box_m
        As for `object_image_motion`.
    px_per_m
        Returns the image of a meter on the nearest surface, px/m, at a time in seconds.

    Returns
    -------
    motion
        Largest displacement of a corner of the box between two times, px.
    """
    corners = np.stack(np.meshgrid(*box_m.T), axis=-1).reshape(-1, 3)

    def motion(t_0_s: float, t_1_s: float) -> float:
        T_0, T_1 = pose([t_0_s, t_1_s])
        moved_m = corners @ (T_1 - T_0)[:3, :3].T + (T_1 - T_0)[:3, 3]
        return float(np.linalg.norm(moved_m, axis=-1).max()) * px_per_m(t_0_s)

    return motion


def adaptive_times(
    motion: ImageMotion, marks_s: Sequence[float], max_displacement_px: float
) -> NDArray[np.float64]:
    """Return frame times between which the image moves at most `max_displacement_px`.

    The next frame is due when the motion since the last one reaches the limit, or at the next mark
    if that comes first.

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

    Raises
    ------
    RenderError
        If `max_displacement_px` is not positive, the marks do not increase, or the image moves so
        fast that frames would be less than 1e-7 s apart.
    """
    _check(marks_s, max_displacement_px)
    return np.array([*_adaptive(motion, marks_s, max_displacement_px)])


def earlier_times(
    motion: ImageMotion, anchor_s: float, start_s: float, max_displacement_px: float
) -> NDArray[np.float64]:
    """Return frame times before an anchor, back to the first time at or before a start.

    They step back from the anchor as `adaptive_times` steps ahead. So they depend on the anchor but
    not on the start: an earlier start only adds times.

    Parameters
    ----------
    motion
        Largest motion in the image between two times.
    anchor_s, start_s
        Times, s, not negative; the start is before the anchor.
    max_displacement_px
        In pixels at render resolution, positive.

    Returns
    -------
    t_s
        (T,) float64, strictly increasing and before the anchor, in seconds.

    Raises
    ------
    RenderError
        As `adaptive_times`.
    """
    marks_s = 0.0, anchor_s  # counted back from the anchor, to the start of the path
    _check(marks_s, max_displacement_px)

    def backward(t_0_s: float, t_1_s: float) -> float:
        return motion(max(0.0, anchor_s - t_0_s), max(0.0, anchor_s - t_1_s))

    times = []
    for back_s in itertools.islice(_adaptive(backward, marks_s, max_displacement_px), 1, None):
        times.append(anchor_s - back_s)
        if times[-1] <= start_s:
            break
    return np.array(times[::-1])


def _adaptive(
    motion: ImageMotion, marks_s: Sequence[float], max_displacement_px: float
) -> Iterator[float]:
    """Yield the times of `adaptive_times`."""
    motion = functools.lru_cache(maxsize=_RECENT)(motion)  # the search repeats calls
    t = float(marks_s[0])
    yield t
    step_s = 1e-4
    for mark_s in map(float, marks_s[1:]):
        while t < mark_s:
            # Short strides from below find motion that turns back.
            rest_s = mark_s - t  # t + rest_s may be less than mark_s
            low, high = 0.0, min(0.5 * step_s, _MAX_STRIDE_S, rest_s)
            while motion(t, t + high) < max_displacement_px and high < rest_s:
                low, high = high, min(1.25 * high, high + _MAX_STRIDE_S, rest_s)
            if motion(t, t + high) > max_displacement_px:
                if motion(t, t + low) >= max_displacement_px:  # by rounding
                    raise _too_fast(max_displacement_px, low, t)
                high = brentq(
                    lambda dt, t=t: motion(t, t + dt) - max_displacement_px, low, high, xtol=1e-9
                )
                if motion(t, t + high) > _MAX_PAST * max_displacement_px:
                    # It jumps there, as where an object enters the view: end just before.
                    high = max(low, high - 2e-9, min(high, _MIN_STEP_S))
                step_s = high
                if high < _MIN_STEP_S:
                    raise _too_fast(max_displacement_px, high, t)
            t = mark_s if mark_s - (t + high) < _TIME_RESOLUTION_S else t + high
            yield t


def paced_times(
    motion: ImageMotion, marks_s: Sequence[float], max_displacement_px: float
) -> NDArray[np.float64]:
    """Return frame times as `adaptive_times`, at less cost, for speeds that hardly change in 4 ms.

    The largest speed in the image is measured every 4 ms. Between two measurements the greater
    speed counts, and frames are evenly spaced in its integral. So there are a few more frames than
    with `adaptive_times`, but the cost does not grow with their number. Vibration and objects that
    cross the view within 4 ms are missed.

    Parameters
    ----------
    motion, marks_s, max_displacement_px
        As for `adaptive_times`.

    Returns
    -------
    t_s
        (T,) float64, strictly increasing, in seconds.

    Raises
    ------
    RenderError
        As `adaptive_times`.
    """
    _check(marks_s, max_displacement_px)
    parts = [np.array(marks_s[:1], np.float64)]
    for start_s, end_s in pairwise(map(float, marks_s)):
        t_s = np.linspace(start_s, end_s, math.ceil((end_s - start_s) / _PACE_S) + 1)
        dt = min(_INSTANT_S, 0.5 * float(t_s[1] - t_s[0]))
        starts = [*t_s[:-1].tolist(), end_s - dt]
        speed = np.array([motion(t, t + dt) for t in starts]) / dt
        least_s = max_displacement_px / float(speed.max()) if speed.any() else math.inf
        if not least_s >= _MIN_STEP_S:
            raise _too_fast(max_displacement_px, least_s, float(t_s[speed.argmax()]))
        steps = np.maximum(speed[:-1], speed[1:]) * np.diff(t_s)
        moved_px = np.concatenate([[0.0], np.cumsum(steps)])
        count = max(1, math.ceil(moved_px[-1] / max_displacement_px))
        inner = np.arange(1, count) * (moved_px[-1] / count)
        parts += [np.interp(inner, moved_px, t_s), np.array([end_s])]
    return np.concatenate(parts)


def _too_fast(moved_px: float, within_s: float, t_s: float) -> RenderError:
    return RenderError(
        f"path: the image moves {moved_px:g} px within {within_s:.1g} s at {t_s:g} s, but frames "
        f"must be at least {_MIN_STEP_S:g} s apart; are the times of the poses in seconds? Moving "
        "objects count too, even out of view"
    )


def _check(marks_s: Sequence[float], max_displacement_px: float) -> None:
    check_positive("max_displacement_px", max_displacement_px, RenderError)
    if len(marks_s) < 2 or not np.all(np.diff(marks_s) > _TIME_RESOLUTION_S):
        raise RenderError(f"marks_s: found {list(marks_s)}, expected two or more increasing times")


def warn_if_far_apart(what: str, max_displacement_px: float) -> None:
    """Warn that events are lost if the image moves far from frame to frame.

    Parameters
    ----------
    what
        Name of the frames.
    max_displacement_px
        Largest motion from frame to frame, px.
    """
    if max_displacement_px > _FAR_APART_PX:
        _log.warning(
            "%s: the image moves up to %g px from frame to frame, above %g px: motion that "
            "reverses between two frames causes no events; at 2 px a fifth of the events is lost",
            what,
            max_displacement_px,
            _FAR_APART_PX,
        )
