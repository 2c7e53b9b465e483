"""Camera pose tracking: the camera's path over some milliseconds, from events of a known plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane, Trajectory
from sensor import Events
from tasks.errors import TaskError

Float64 = NDArray[np.float64]

CONTROL_POSES = 10  # so 7 segments
KNOT_INTERVAL_S = 0.002
PATH_S = (CONTROL_POSES - 3) * KNOT_INTERVAL_S
_SCORED_EVERY_S = 1e-4
_SUCCESS_SHARE = 0.5


@dataclass(frozen=True, eq=False, slots=True, weakref_slot=True)
class TrackingSample:
    """What a tracking method may use.

    Time 0 is the start of the path to estimate, and the time of the reference view. Positions are
    in pixels of the sensor, (0, 0) at its top-left corner and pixel centers at integers + 0.5.
    Poses are T_world_cam with OpenCV's axes.

    Parameters
    ----------
    x, y
        (N,) uint16, pixel of each event. Events are sorted by pixel (y, x), then by time.
    t_us
        (N,) int32, from 0 to below the sum of the path's duration and `max_delay_us`.
    t_before_us
        (N,) int32, time of the previous event at the pixel, which is also the previous one in
        these arrays; -1 for the first of a pixel.
    p
        (N,) int8, polarity.
    log_image
        (h, w) float64, L_l: log intensity of the reference view at the sensor's resolution.
    contrast_threshold
        C, known in simulation, log units.
    camera
        Pinhole camera with the size of the sensor; its `K` is the camera matrix.
    plane
        The plane that the camera sees, in world coordinates.
    T_0
        (4, 4), pose of the reference view.
    initial
        Path from which to start the search: a cumulative cubic B-spline.
    initial_sigma_m
        Standard deviation of the control positions' errors per component.
    max_delay_us
        Largest delay of the events; the sample has events up to this long after the path's end.
    """

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_us: NDArray[np.int32]
    t_before_us: NDArray[np.int32]
    p: NDArray[np.int8]
    log_image: Float64
    contrast_threshold: float
    camera: Camera
    plane: Plane
    T_0: Float64
    initial: Trajectory
    initial_sigma_m: float
    max_delay_us: int = 0


@dataclass(frozen=True, slots=True)
class TrackingDiagnostics:
    """Diagnostics of a search.

    Parameters
    ----------
    cost
        Mean robust cost of a residual at the end, squared log units.
    passes
        Number of passes over the events, on all levels together.
    residuals
        Number of events with an earlier one at their pixel: the terms of the sum.
    outside
        Number of these whose point is outside the reference view at the end.
    delay_us
        Estimated delay of the events, microseconds.
    """

    cost: float
    passes: int
    residuals: int
    outside: int
    delay_us: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class TrackingEstimate:
    """A method's answer.

    Parameters
    ----------
    path
        The camera's path from time 0, at least as long as the initial one; the initial one after a
        failure.
    failure
        Reason for a failure, or "". Failures are counted, not dropped.
    diagnostics
        Diagnostics of the search; None if there was none.
    """

    path: Trajectory
    failure: str = ""
    diagnostics: TrackingDiagnostics | None = None


def path_at(pose: Callable[[Float64], Float64], start_s: float) -> Trajectory:
    """Return the spline whose control poses lie on a path; its time 0 is `start_s`.

    It deviates from the path by a sixth of the acceleration times the squared knot interval: some
    micrometers for a hand-held camera.

    Parameters
    ----------
    pose
        Function from (M,) seconds to (M, 4, 4) T_world_cam, such as `Trajectory.pose`. It is called
        up to one knot interval before `start_s` and after the spline's end.
    start_s
        Start of the spline, seconds in the time of `pose`.

    Returns
    -------
    The spline.
    """
    knots_s = KNOT_INTERVAL_S * np.arange(-1.0, CONTROL_POSES - 1)
    return Trajectory(knots_s, pose(start_s + knots_s))


def perturbed(path: Trajectory, sigma_m: float, seed: int | Sequence[int]) -> Trajectory:
    """Add Gaussian noise to the positions of a path's control poses.

    Parameters
    ----------
    path
        The path.
    sigma_m
        Standard deviation per component.
    seed
        Seed of the noise, as for `numpy.random.default_rng`.

    Returns
    -------
    The perturbed path.
    """
    controls = path.controls.copy()
    controls[:, :3, 3] += np.random.default_rng(seed).normal(0.0, sigma_m, (len(controls), 3))
    return Trajectory(path.knots_s, controls)


def tracking_sample(
    events: Events,
    start_us: int,
    log_image: Float64,
    contrast_threshold: float,
    camera: Camera,
    plane: Plane | None,
    T_0: Float64,
    initial: Trajectory,
    initial_sigma_m: float,
    *,
    max_events: int | None = None,
    max_delay_us: int = 0,
    seed: int = 0,
) -> TrackingSample:
    """Select the events of one path.

    Parameters
    ----------
    events
        Events of the whole sensor.
    start_us
        Start of the path and time of the reference view, microseconds in the events' time.
    log_image, contrast_threshold, camera, T_0, initial, initial_sigma_m, max_delay_us
        As in `TrackingSample`.
    plane
        The scene's plane; None is refused.
    max_events
        Keep only the events of randomly chosen pixels, at most this many in all; None for all.
    seed
        Seed of the choice of pixels.

    Returns
    -------
    What a tracking method may use.

    Raises
    ------
    TaskError
        The scene is not planar, the camera has a lens, the sizes of events, image and camera
        differ, or `T_0` is not 4 x 4.
    """
    if plane is None:
        raise TaskError("tracking: needs a planar scene, but this one has depth")
    size = (events.height, events.width)
    for name, value, expected in (
        ("lens", camera.distortion, None),
        ("log_image", log_image.shape, size),
        ("camera", (camera.height, camera.width), size),
        ("T_0", T_0.shape, (4, 4)),
    ):
        if value != expected:
            raise TaskError(f"tracking: {name}: found {value}, expected {expected}")
    duration_us = round(initial.duration_s * 1e6) + max_delay_us
    window = events.between(start_us, start_us + duration_us)
    if max_events is not None:
        rank = random_ranks(seed, *size)[window.y, window.x]
        window = window.where(rank < most_pixels(rank, max_events))
    pixel = window.y.astype(np.int32) * events.width + window.x
    order = np.argsort(pixel, kind="stable")
    t_us = (window.t_us[order] - start_us).astype(np.int32)
    t_before_us = np.full_like(t_us, -1)
    same = pixel[order[1:]] == pixel[order[:-1]]
    t_before_us[1:][same] = t_us[:-1][same]
    return TrackingSample(
        x=window.x[order],
        y=window.y[order],
        t_us=t_us,
        t_before_us=t_before_us,
        p=window.p[order],
        log_image=np.ascontiguousarray(log_image),
        contrast_threshold=contrast_threshold,
        camera=camera,
        plane=plane,
        T_0=T_0,
        initial=initial,
        initial_sigma_m=initial_sigma_m,
        max_delay_us=max_delay_us,
    )


@lru_cache(maxsize=8)
def random_ranks(seed: int, height: int, width: int) -> NDArray[np.int32]:
    """Return the rank of each pixel in a random order.

    Parameters
    ----------
    seed
        Seed of the order.
    height, width
        Size of the sensor, px.

    Returns
    -------
    (height, width) int32, read-only.
    """
    ranks = np.random.default_rng(seed).permutation(height * width).astype(np.int32)
    ranks.flags.writeable = False
    return ranks.reshape(height, width)


def most_pixels(rank: NDArray[np.int32], max_events: int) -> int:
    """Return how many pixels of the lowest ranks have at most max_events events together.

    Parameters
    ----------
    rank
        Rank of the pixel of each event.
    max_events
        Number of events.

    Returns
    -------
    int
        The number of pixels; more events never raise it.
    """
    return int(np.searchsorted(np.cumsum(np.bincount(rank)), max_events, side="right"))


def position_error_mm(
    path: Trajectory, pose: Callable[[Float64], Float64], start_s: float, duration_s: float
) -> float:
    """Return the mean distance between estimated and true camera centers, every 0.1 ms.

    Nothing is aligned, as the plane and the reference view fix the coordinate frame.

    Parameters
    ----------
    path
        Estimated path; its time 0 is `start_s`.
    pose
        The truth: function from (M,) seconds to (M, 4, 4), as in `path_at`.
    start_s
        Start of the path, seconds in the time of `pose`.
    duration_s
        Duration to score, seconds: that of the initial path.

    Returns
    -------
    The error, mm.
    """
    t_s = np.linspace(0.0, duration_s, round(duration_s / _SCORED_EVERY_S) + 1)
    off = path.pose(t_s)[:, :3, 3] - pose(start_s + t_s)[:, :3, 3]
    return float(1e3 * np.linalg.norm(off, axis=1).mean())


def succeeded(estimate: TrackingEstimate, error_mm: float, initial_error_mm: float) -> bool:
    """Return whether a method succeeded: its error is below half the initial path's error.

    A search that converged ends far below that (its error depends on sensor and light, not on its
    start), and one that did not stays near the initial error or goes beyond it. So the success rate
    separates convergence from accuracy, at any size of the perturbation.

    Parameters
    ----------
    estimate
        The method's answer.
    error_mm, initial_error_mm
        Errors of the answer and of the initial path, mm.

    Returns
    -------
    Whether the method succeeded.
    """
    return not estimate.failure and error_mm < _SUCCESS_SHARE * initial_error_mm


def failure_of(
    estimate: TrackingEstimate, initial: Trajectory, error_mm: float, initial_error_mm: float
) -> str:
    """Return why a method failed: its own reason, or that it moved the path and did not succeed.

    Parameters
    ----------
    estimate
        The method's answer.
    initial
        The path from which it started.
    error_mm, initial_error_mm
        As for `succeeded`.

    Returns
    -------
    The reason, or "".
    """
    path = estimate.path  # a method may get a copy
    same = np.array_equal(path.knots_s, initial.knots_s)
    moved = not (same and np.array_equal(path.controls, initial.controls))
    lost = moved and not succeeded(estimate, error_mm, initial_error_mm)
    return estimate.failure or ("ended far off" if lost else "")
