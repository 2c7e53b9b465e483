"""Estimate a path from a sample, without and with a delay of the events."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Trajectory, path_through
from eres_render.camera import map_pixels, plane_homography
from tasks.errors import TaskError
from tasks.methods.photometric_tracking.accumulation import HUBER_IN_C
from tasks.methods.photometric_tracking.reference_views import Level, pyramid
from tasks.methods.photometric_tracking.residuals import Problem, distance_m, knots_us, problem_of
from tasks.methods.photometric_tracking.search import Result, search
from tasks.tracking import TrackingDiagnostics, TrackingEstimate, TrackingSample

_MIN_INSIDE = 0.5
_EXTRAPOLATION_PX = 1.0  # error of a path that is extended beyond its events


def estimate(sample: TrackingSample) -> TrackingEstimate:
    """Find the path that best explains the changes between consecutive events of each pixel.

    Coarse to fine: the reference view is blurred and halved until the perturbation of the initial
    path moves it by less than a pixel; then the search runs from the coarsest view to the view
    itself. Events are not blurred. So on level k, Eq. (14) is summed over 2^k events at a time,
    which carry less fine detail, and the blurred view is scaled by its `gain`.

    Raises
    ------
    TaskError
        The initial path's knots are not even, or not a whole number of microseconds apart.
    """
    start = _start_of(sample)
    if start.failure:
        return TrackingEstimate(sample.initial, start.failure)
    result = start.result
    if start.finest:
        result = search(start.problem, result[0], [start.finest], passes=result[2])
    diagnostics, failure = _judge(start.problem, sample, result)
    return TrackingEstimate(sample.initial if failure else result[0], failure, diagnostics)


def estimate_with_delay(sample: TrackingSample) -> TrackingEstimate:
    """As `estimate`, with a constant delay of all events as one more unknown.

    Events with a delay d are those of the path T(t - d), so events alone cannot separate a delay
    from another path: for any d, a path shifted in time fits as well. But the camera was at T_0 at
    time 0, when the reference view was taken. So the path of the late events is estimated over its
    duration and `sample.max_delay_us`: first its beginning, as in `estimate` without the finest
    level, then all of it, with little blur. The delay is the time at which that path sees the
    reference view, by the least mean squared distance in the image.

    Raises
    ------
    TaskError
        As `estimate`, or `sample.max_delay_us` is 0.
    """
    if sample.max_delay_us <= 0:
        raise TaskError(
            f"delay: found max_delay_us = {sample.max_delay_us} in the sample, expected a positive "
            "number, the largest delay to search"
        )
    start = _start_of(sample)
    begun, blur_px = sample.initial, _blur_px(sample)
    if start.result[3]:  # it converged, so it did not fail
        begun, blur_px = start.result[0], _EXTRAPOLATION_PX
    late = _extended(begun, sample.max_delay_us)
    events_end_us = round(1e6 * sample.initial.duration_s) + sample.max_delay_us
    problem, failure = problem_of(sample, min(knots_us(late)[1], events_end_us))
    if failure:
        return TrackingEstimate(sample.initial, failure)
    result = search(problem, late, pyramid(sample.log_image, sample.camera.K, blur_px))
    path = result[0]
    diagnostics, failure = _judge(problem, sample, result)
    delay_us = _delay_us(sample, path)
    diagnostics = replace(diagnostics, delay_us=float(delay_us))
    if not failure and delay_us == sample.max_delay_us:  # 0 is a valid answer
        failure = "the delay ended at its bound"
    if failure:
        return TrackingEstimate(sample.initial, failure, diagnostics)
    t_s = np.linspace(0.0, sample.initial.duration_s, 4 * len(sample.initial.knots_s))
    return TrackingEstimate(path_through(t_s, path.pose(t_s + 1e-6 * delay_us)), "", diagnostics)


def _blur_px(sample: TrackingSample) -> float:
    """Return how far the perturbation of the initial path moves the image, px."""
    return sample.camera.focal_px * sample.initial_sigma_m / distance_m(sample)


class _Start(NamedTuple):
    """The events without delay, and their search on all levels but the finest, if there are more.

    `result` is as `search` returns it; `failure` says why there was no search.
    """

    problem: Problem
    failure: str
    result: Result
    finest: Level | None


_starts: WeakKeyDictionary[TrackingSample, tuple[list[int], _Start]] = WeakKeyDictionary()


def _start_of(sample: TrackingSample) -> _Start:
    """Return the start that both methods share; it is kept as long as its sample is the same."""
    checksums = _checksums(sample)
    known, start = _starts.get(sample, (None, None))
    if start is None or known != checksums:
        problem, failure = problem_of(sample, knots_us(sample.initial)[1])
        views = pyramid(sample.log_image, sample.camera.K, _blur_px(sample))
        levels = [] if failure else list(views)
        result = search(problem, sample.initial, levels[:-1] or levels)
        start = _Start(problem, failure, result, levels[-1] if levels[1:] else None)
        _starts[sample] = checksums, start
    return start


def _checksums(sample: TrackingSample) -> list[int]:
    """Return checksums of a sample's arrays, which a user's method may change in place."""
    arrays = (
        *(sample.x, sample.y, sample.t_us, sample.t_before_us, sample.p, sample.log_image),
        *(sample.T_0, sample.initial.knots_s, sample.initial.controls),
    )
    return [crc32(np.ascontiguousarray(array).data) for array in arrays]


def _judge(
    problem: Problem, sample: TrackingSample, result: Result
) -> tuple[TrackingDiagnostics, str]:
    """Return the diagnostics of a search, and the reason of a failure."""
    _, state, passes, converged = result
    diagnostics = TrackingDiagnostics(
        state.cost / problem.residuals, passes, problem.residuals, state.outside
    )
    huber = HUBER_IN_C * sample.contrast_threshold
    failure = "" if converged else f"no convergence in {passes} passes"
    if not math.isfinite(state.cost):
        failure = "the cost is not finite"
    elif state.outside > (1 - _MIN_INSIDE) * problem.residuals:
        failure = f"{state.outside} of {problem.residuals} events left the reference view"
    elif diagnostics.cost >= huber * (sample.contrast_threshold - 0.5 * huber):
        failure = "explains the events no better than standing still"
    return diagnostics, failure


def _extended(path: Trajectory, by_us: int) -> Trajectory:
    """Extend a path with its mean velocity.

    The last control pose is replaced too, as the search leaves it undetermined.
    """
    interval_us, _ = knots_us(path)
    end_s, interval_s = path.duration_s, 1e-6 * interval_us
    more = math.ceil(by_us / interval_us)
    knots_s = interval_s * np.arange(-1.0, len(path.controls) + more - 1)
    share = (knots_s[len(path.controls) - 1 :, None] - end_s) / end_s
    first, last = path.pose(np.array([0.0, end_s]))
    turn = Rotation.from_matrix(last[:3, :3] @ first[:3, :3].T).as_rotvec()
    controls = np.tile(last, (len(share), 1, 1))
    controls[:, :3, 3] += share * (last[:3, 3] - first[:3, 3])
    controls[:, :3, :3] = Rotation.from_rotvec(share * turn).as_matrix() @ last[:3, :3]
    return Trajectory(knots_s, np.concatenate([path.controls[:-1], controls]))


def _delay_us(sample: TrackingSample, path: Trajectory) -> int:
    """Return the time at which the path sees the reference view, to 10 us or at the bound."""
    t_us = np.unique([*range(0, sample.max_delay_us, 10), sample.max_delay_us])
    points_px = sample.camera.grid(9)
    H = plane_homography(sample.camera.K, sample.T_0, path.pose(t_us * 1e-6), sample.plane)
    off_px = map_pixels(H, points_px) - points_px
    return int(t_us[np.argmin(np.sum(off_px**2, axis=(1, 2)))])
