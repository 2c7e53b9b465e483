"""The events that give a residual, and the data that do not change with the path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from tasks.errors import TaskError
from tasks.tracking import TrackingSample

Float64 = NDArray[np.float64]
Intrinsics = tuple[float, float, float, float]  # focal lengths and principal point, px

RESIDUALS_PER_UNKNOWN = 10  # with fewer, there are too few events
_COARSE_RESIDUALS = 8000  # enough for a blurred reference view


def knots_us(path: Trajectory) -> tuple[int, int]:
    """Return the interval between a path's knots, and its duration, in microseconds."""
    intervals_us = 1e6 * np.diff(path.knots_s)
    interval_us = round(intervals_us[0])
    if interval_us < 1 or np.abs(intervals_us - interval_us).max() > 1e-3:
        raise TaskError(
            f"path: found knots {intervals_us.min():g} to {intervals_us.max():g} us apart, "
            "expected even intervals of whole microseconds"
        )
    return interval_us, interval_us * (len(path.knots_s) - 3)


class PixelEvents(NamedTuple):
    """Events sorted by pixel, as in `TrackingSample`; arrays are (N,)."""

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_us: NDArray[np.int32]
    t_before_us: NDArray[np.int32]
    p: NDArray[np.int16]  # or sums of several polarities


class Geometry(NamedTuple):
    """The sensor's rays, the pose of the reference view, and the plane that both see."""

    rays: Intrinsics  # of the sensor
    R_0: Float64  # (3, 3) rotation of T_0
    p_0: Float64  # (3,) position of T_0
    plane: Float64  # (4,) n and offset, with n . X = offset


class Problem(NamedTuple):
    """Events of a sample within the path's duration, and other constants of a search."""

    events: PixelEvents
    geometry: Geometry
    residuals: int
    contrast_threshold: float
    interval_us: int  # from knot to knot
    distance_m: float  # from the reference view to the plane


def problem_of(sample: TrackingSample, duration_us: int) -> tuple[Problem, str]:
    """Select the events of a sample that have another event before or after them at their pixel.

    The text says why the problem cannot be solved, or is "".
    """
    inside = sample.t_us < duration_us  # there may be events after the end of the path
    follows = inside & (sample.t_before_us >= 0)
    residuals = int(np.count_nonzero(follows))
    inside &= follows | np.append(follows[1:], False)  # a pixel's only event gives no residual
    x, y, t_us, t_before_us, p = (getattr(sample, name)[inside] for name in PixelEvents._fields)
    events = PixelEvents(x, y, t_us, t_before_us, p.astype(np.int16))
    wanted = RESIDUALS_PER_UNKNOWN * 6 * len(sample.initial.knots_s)
    problem = Problem(
        events=events,
        geometry=Geometry(
            intrinsics(sample.camera.K),
            np.ascontiguousarray(sample.T_0[:3, :3]),
            sample.T_0[:3, 3].copy(),
            np.array([*sample.plane.normal, sample.plane.offset_m]),
        ),
        residuals=residuals,
        contrast_threshold=sample.contrast_threshold,
        interval_us=knots_us(sample.initial)[0],
        distance_m=distance_m(sample),
    )
    lacking = f"{residuals} events with one before them, expected {wanted}"
    return problem, lacking if residuals < wanted else ""


def intrinsics(K: Float64) -> Intrinsics:
    """Return the focal lengths and the principal point of a camera matrix, px."""
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def distance_m(sample: TrackingSample) -> float:
    """Return the distance of the reference view from the plane along its axis, m."""
    return float(sample.plane.distance(sample.T_0[:3, 3], sample.T_0[:3, 2]))


def join_events(problem: Problem, events: int) -> Problem:
    """Join consecutive events at a pixel into one, with the sum of their polarities.

    Returns those with one before them, by the segments of the path in which the two are.
    """
    x, y, t_us, t_before_us, p = problem.events
    if events > 1:
        number = np.arange(len(t_us))
        first = t_before_us < 0
        since_first = number - np.maximum.accumulate(np.where(first, number, 0))
        ends = (since_first % events == 0) | np.append(first[1:], True)  # also a pixel's last
        every = math.ceil(np.count_nonzero(ends & ~first) / _COARSE_RESIDUALS)
        chosen = np.flatnonzero(ends & (np.cumsum(first) % every == 0))
        total = np.cumsum(p, dtype=np.int64)[chosen]  # a pixel's first one does not matter
        x, y, t_us, first = x[chosen], y[chosen], t_us[chosen], first[chosen]
        p = np.diff(total, prepend=0).astype(np.int16)
        t_before_us = np.where(first, -1, np.roll(t_us, 1)).astype(np.int32)
    later = np.flatnonzero(t_before_us >= 0)
    segments = t_us[later] // problem.interval_us, t_before_us[later] // problem.interval_us
    later = later[np.lexsort(segments)]
    return problem._replace(
        events=PixelEvents(x[later], y[later], t_us[later], t_before_us[later], p[later]),
        residuals=len(later),
    )
