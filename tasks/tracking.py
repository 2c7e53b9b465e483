"""Camera pose tracking: the camera's path over some milliseconds, from events of a known plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane, Trajectory
from sensor import Events
from tasks.errors import TaskError

Float64 = NDArray[np.float64]

CONTROL_POSES = 10  # so 7 segments
KNOT_INTERVAL_S = 0.002
_SCORED_EVERY_S = 1e-4
_SUCCESS_SHARE = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class TrackingSample:
    """What a tracking method may use.

    Time 0 is the start of the path that is looked for, which is when the reference view was taken.
    Positions are in pixels of the sensor, (0, 0) at its top-left corner and pixel centres at
    integers + 0.5. Poses are T_world_cam with OpenCV's axes.

    Parameters
    ----------
    x, y
        (N,) uint16, pixel of each event. Events are in order of their pixel (y, x), and in order of
        time at a pixel.
    t_us
        (N,) int32, at least 0 and less than the path's duration and `max_delay_us` together.
    t_before_us
        (N,) int32, time of the event before it at its pixel, which is also the one before it in
        these arrays; -1 for a pixel's first.
    p
        (N,) int8, polarity.
    log_image
        (h, w) float64, L_l: log intensity of the reference view at the sensor's resolution.
    contrast_threshold
        C, known in simulation.
    camera
        Of the sensor's size; its `K` is the camera matrix.
    plane
        All that the camera sees, in world coordinates.
    T_0
        (4, 4), pose of the reference view.
    initial
        Path to start the search from: a cumulative cubic B-spline, by its control poses.
    initial_sigma_m
        How far, in standard deviations per component, the control poses may be off.
    max_delay_us
        Events may be late by so much. There are then events after the path's end, up to so late.
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
    """How a search went.

    Parameters
    ----------
    cost
        Mean robust cost of a residual at the end, squared log units.
    passes
        Over the events, on all levels together.
    residuals
        Events with one before them at their pixel: the terms of the sum.
    outside
        How many of these see, at the end, a point that is not in the reference view.
    delay_us
        By how much events were found to be late.
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
        The camera's path, from time 0 at least as long as the initial one.
    failure
        Why there is no answer to trust, or "" where there is one. What failed is counted, not
        dropped: its path is the initial one.
    diagnostics
        None where no search was begun.
    """

    path: Trajectory
    failure: str = ""
    diagnostics: TrackingDiagnostics | None = None


EstimatePath = Callable[[TrackingSample], TrackingEstimate]


def path_at(
    pose: Callable[[Float64], Float64],
    start_s: float,
    control_poses: int = CONTROL_POSES,
    knot_interval_s: float = KNOT_INTERVAL_S,
) -> Trajectory:
    """The spline whose control poses lie on a path; time 0 of the spline is `start_s`.

    It keeps to the path to within a sixth of the acceleration times the squared knot interval,
    some micrometres for a camera in a hand.

    Parameters
    ----------
    pose
        From (M,) seconds to (M, 4, 4) T_world_cam, such as `Trajectory.pose`. It is asked for one
        knot interval before `start_s` and one after the spline's end.
    """
    knots_s = knot_interval_s * np.arange(-1.0, control_poses - 1)
    return Trajectory(knots_s, pose(start_s + knots_s))


def perturbed(path: Trajectory, sigma_m: float, seed: int) -> Trajectory:
    """The path with Gaussian noise on every component of its control poses' positions."""
    controls = path.controls.copy()
    noise = np.random.default_rng(seed).normal(0.0, sigma_m, (len(controls), 3))
    controls[:, :3, 3] += noise
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
    """Cut the events of one path out of a stream that has them all.

    Parameters
    ----------
    events
        Of the whole sensor.
    start_us
        When the path starts and the reference view was taken, in the events' time.
    plane
        The scene's; None, as of a scene with depth, is refused.
    max_events
        Keep the events of randomly chosen pixels only, as many as make at most so many events;
        None for all.
    seed
        Of the choice of pixels.

    The rest is as in `TrackingSample`.

    Raises
    ------
    TaskError
        The scene is not planar, the sizes of events, image and camera differ, or the path lasts no
        time.
    """
    if plane is None:
        raise TaskError("tracking: found a scene with depth, expected a plane")
    size = (events.height, events.width)
    for name, found in (
        ("log_image", log_image.shape),
        ("camera", (camera.height, camera.width)),
    ):
        if found != size:
            raise TaskError(f"tracking: found a {name} of {found}, expected {size}, the events'")
    if T_0.shape != (4, 4):
        raise TaskError(f"tracking: found T_0 of shape {T_0.shape}, expected (4, 4)")
    if max_delay_us < 0:
        raise TaskError(f"tracking: found max_delay_us = {max_delay_us}, expected 0 or more")
    duration_us = round(initial.duration_s * 1e6) + max_delay_us
    window = events.between(start_us, start_us + duration_us)
    pixel = window.y.astype(np.int32) * events.width + window.x
    if max_events is not None and len(window) > max_events:
        kept = _random_pixels(pixel, events.height * events.width, max_events, seed)[pixel]
    else:
        kept = np.ones(len(window), bool)
    order = np.flatnonzero(kept)[np.argsort(pixel[kept], kind="stable")]
    t_us = (window.t_us[order] - start_us).astype(np.int32)
    t_before_us = np.full_like(t_us, -1)
    same = pixel[order[1:]] == pixel[order[:-1]]
    t_before_us[1:][same] = t_us[:-1][same]
    return TrackingSample(
        window.x[order],
        window.y[order],
        t_us,
        t_before_us,
        window.p[order],
        log_image,
        contrast_threshold,
        camera,
        plane,
        T_0,
        initial,
        initial_sigma_m,
        max_delay_us,
    )


def _random_pixels(
    pixel: NDArray[np.int32], pixels: int, max_events: int, seed: int
) -> NDArray[np.bool_]:
    """Mark pixels, drawn in random order, that have no more than max_events events in all."""
    counts = np.bincount(pixel, minlength=pixels)
    order = np.random.default_rng(seed).permutation(np.flatnonzero(counts))
    kept = np.zeros(pixels, bool)
    kept[order[np.cumsum(counts[order]) <= max_events]] = True
    return kept


def position_error_mm(
    path: Trajectory, pose: Callable[[Float64], Float64], start_s: float, duration_s: float
) -> float:
    """Mean distance of the camera centre from the true one, every 0.1 ms, in mm.

    Nothing is aligned: the plane and the reference view fix the frame of reference.

    Parameters
    ----------
    path
        Estimated, its time 0 at `start_s`.
    pose
        The truth, from (M,) seconds to (M, 4, 4), as in `path_at`.
    duration_s
        How much of it to score, the initial path's duration.
    """
    t_s = np.linspace(0.0, duration_s, round(duration_s / _SCORED_EVERY_S) + 1)
    off = path.pose(t_s)[:, :3, 3] - pose(start_s + t_s)[:, :3, 3]
    return float(1e3 * np.linalg.norm(off, axis=1).mean())


def succeeded(estimate: TrackingEstimate, error_mm: float, initial_error_mm: float) -> bool:
    """Whether a method gave an answer, and one nearer than half the initial path's error.

    Half, because a search that has found the path ends far below it (its error depends on sensor
    and light, not on where it began), and one that has not stays at it or goes beyond. So the rate
    of success tells convergence apart from accuracy, at any size of perturbation.
    """
    return not estimate.failure and error_mm < _SUCCESS_SHARE * initial_error_mm
