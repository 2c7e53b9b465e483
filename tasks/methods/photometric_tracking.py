"""Event-based Photometric Pose Tracker (EPPT), Eqs. (13) to (15), with C known.

Between two events at a pixel the light there changed by C. What the pixel saw is found in the
reference view: its ray meets the plane, and the point is projected into the reference view, Eq.
(13). So each event with one before it at its pixel gives one residual, Eq. (14),

    r_k = p_k (L_l(x'_1) - L_l(x'_0)) - C ,

in the control poses of the path. Their robust sum of squares, Eq. (15), is minimised with
Levenberg-Marquardt in all six degrees of freedom of every control pose. The paper perturbs only the
positions, but looks for the poses; a camera that turns less than a pixel in 14 ms cannot be told
beforehand from one that moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render import Trajectory, path_through
from eres_render.camera import map_pixels, plane_homography
from tasks.errors import TaskError
from tasks.numerics import bicubic, cumulative_spline
from tasks.tracking import TrackingDiagnostics, TrackingEstimate, TrackingSample

Float64 = NDArray[np.float64]

RESIDUALS_PER_UNKNOWN = 10  # at least, else there are too few events
_HUBER_IN_C = 0.5
_COARSEST_PX = 16  # of the reference view at its coarsest
_MAX_PASSES = 60  # on one level
_COARSE_RESIDUALS = 8000  # are enough where the reference view is blurred
_CONVERGED_PX = 0.02  # a step of less is the last, by the control poses' root mean square
_CONVERGED_NOISE = 0.1  # and one that gains less than so much of what noise does to the minimum
_LEAST_INSIDE = 0.5
_EXTRAPOLATION_PX = 1.0  # how well a path is known where it goes on beyond its events


def estimate(sample: TrackingSample) -> TrackingEstimate:
    """Path that best explains the brightness steps between consecutive events of each pixel.

    Coarse to fine: the reference view is blurred and halved until the perturbation of the initial
    path moves it by less than a pixel, then the search runs from the coarsest view to the view
    itself. Events know nothing of the blur. So on level k, Eq. (14) is added up over 2^k events at
    a time, whose sum carries less of the fine detail, and the blurred view is scaled by its `gain`.

    Raises
    ------
    TaskError
        The initial path's knots are not even, or not a whole number of microseconds apart.
    """
    knots = _Knots.of(sample.initial)
    problem, failure = _problem(sample, knots.duration_us)
    if failure:
        return TrackingEstimate(sample.initial, failure)
    path, diagnostics, failure = _solve(problem, sample, sample.initial, knots, _blur_px(sample))
    return TrackingEstimate(sample.initial if failure else path, failure, diagnostics)


def estimate_with_delay(sample: TrackingSample) -> TrackingEstimate:
    """As `estimate`, with a constant delay of all events as one more unknown.

    Events that are late by d are those of the path T(t - d), so events alone cannot tell a delay
    from another path: any d is as good, with the path moved in time. What tells is that the camera
    was at T_0 at time 0, when the reference view was taken. So the path of the late events is
    estimated first, over the path's duration and `sample.max_delay_us`: its beginning as by
    `estimate`, but for the finest level, and from there all of it, hardly blurred. The delay is the
    time at which it sees what the reference view shows, by the least mean squared distance in the
    image.

    Raises
    ------
    TaskError
        As `estimate`, or `sample.max_delay_us` is 0.
    """
    if sample.max_delay_us <= 0:
        raise TaskError(
            f"delay: found max_delay_us = {sample.max_delay_us} in the sample, expected the "
            "largest delay to look for"
        )
    begun, blur_px = _begun(sample)
    late = _extended(begun, _Knots.of(sample.initial), sample.max_delay_us)
    knots = _Knots.of(late)
    problem, failure = _problem(sample, min(knots.duration_us, _duration_us(sample)))
    if failure:
        return TrackingEstimate(sample.initial, failure)
    path, diagnostics, failure = _solve(problem, sample, late, knots, blur_px)
    delay_s = _delay_s(sample, path)
    diagnostics = replace(diagnostics, delay_us=1e6 * delay_s)
    if not failure and 1e6 * delay_s >= sample.max_delay_us:  # none at all is an answer
        failure = "the delay ended at its bound"
    if failure:
        return TrackingEstimate(sample.initial, failure, diagnostics)
    t_s = np.linspace(0.0, sample.initial.duration_s, 4 * len(sample.initial.knots_s))
    return TrackingEstimate(path_through(t_s, path.pose(t_s + delay_s)), "", diagnostics)


@dataclass(frozen=True, slots=True)
class _Knots:
    """Even knots of a path, in whole microseconds."""

    interval_us: int
    duration_us: int

    @classmethod
    def of(cls, path: Trajectory) -> _Knots:
        intervals_us = 1e6 * np.diff(path.knots_s)
        interval_us = round(intervals_us[0])
        if interval_us < 1 or np.abs(intervals_us - interval_us).max() > 1e-3:
            raise TaskError(
                f"path: found knots {intervals_us.min():g} to {intervals_us.max():g} us apart, "
                "expected even intervals of whole microseconds"
            )
        return cls(interval_us, interval_us * (len(path.knots_s) - 3))


@dataclass(frozen=True, eq=False, slots=True)
class _Problem:
    """The events of a sample that lie in the path's duration, and what does not change with it."""

    x: NDArray[np.uint16]
    y: NDArray[np.uint16]
    t_us: NDArray[np.int32]
    t_before_us: NDArray[np.int32]
    p: NDArray[np.integer]
    rays: tuple[float, float, float, float]  # focal lengths and principal point of the sensor, px
    reference: tuple[Float64, Float64]  # rotation and position of T_0
    plane: Float64  # (4,) n_x, n_y, n_z, offset
    seen_us: NDArray[np.bool_]  # (T,) whether there is an event at each microsecond of the path
    residuals: int


def _duration_us(sample: TrackingSample) -> int:
    return round(1e6 * sample.initial.duration_s) + sample.max_delay_us


def _blur_px(sample: TrackingSample) -> float:
    """By how much the perturbation of the initial path moves the image."""
    return sample.camera.focal_px * sample.initial_sigma_m / _distance_m(sample)


def _distance_m(sample: TrackingSample) -> float:
    return float(sample.plane.distance(sample.T_0[:3, 3], sample.T_0[:3, 2]))


def _problem(sample: TrackingSample, duration_us: int) -> tuple[_Problem, str]:
    inside = sample.t_us < duration_us  # not all, where there are events after the path's end
    follows = inside & (sample.t_before_us >= 0)
    residuals = int(np.count_nonzero(follows))
    inside &= follows | np.append(follows[1:], False)  # a pixel's only event says nothing
    t_us, t_before_us = sample.t_us[inside], sample.t_before_us[inside]
    wanted = RESIDUALS_PER_UNKNOWN * 6 * len(sample.initial.knots_s)
    problem = _Problem(
        sample.x[inside],
        sample.y[inside],
        t_us,
        t_before_us,
        sample.p[inside],
        _intrinsics(sample.camera.K),
        (np.ascontiguousarray(sample.T_0[:3, :3]), sample.T_0[:3, 3].copy()),
        np.array([*sample.plane.normal, sample.plane.offset_m]),
        _seen_us(t_us, duration_us),
        residuals,
    )
    if residuals < wanted:
        return problem, f"{residuals} events with one before them, expected {wanted}"
    return problem, ""


def _seen_us(t_us: NDArray[np.int32], duration_us: int) -> NDArray[np.bool_]:
    seen = np.zeros(duration_us, bool)
    seen[t_us] = True
    return seen


def _intrinsics(K: Float64) -> tuple[float, float, float, float]:
    return float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2])


def _joined(problem: _Problem, events: int) -> _Problem:
    """Take so many consecutive events at a pixel as one, with the sum of their polarities.

    What is left over at a pixel's end is one more. If the problem is a coarse one, with more than
    one, and still large, every so manieth pixel stands for all.
    """
    if events == 1:
        return problem
    number = np.arange(len(problem.t_us))
    first = problem.t_before_us < 0
    since_first = number - np.maximum.accumulate(np.where(first, number, 0))
    last = np.append(first[1:], True)
    joined = (since_first % events == 0) | last
    every = math.ceil(np.count_nonzero(joined & ~first) / _COARSE_RESIDUALS)
    kept = np.flatnonzero(joined & (np.cumsum(first) % every == 0))
    first, t_us = first[kept], problem.t_us[kept]
    total = np.cumsum(problem.p, dtype=np.int64)[kept]  # of a pixel's first it is of no account
    return replace(
        problem,
        x=problem.x[kept],
        y=problem.y[kept],
        t_us=t_us,
        t_before_us=np.where(first, -1, np.roll(t_us, 1)).astype(np.int32),
        p=np.diff(total, prepend=0).astype(np.int16),
        seen_us=_seen_us(t_us, len(problem.seen_us)),
        residuals=int(np.count_nonzero(~first)),
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Level:
    """A reference view, coarser or not.

    Parameters
    ----------
    image
        (h, w) float64, log intensity.
    intrinsics
        Focal lengths and principal point of this view, in its pixels.
    events
        How many at a pixel are taken as one.
    """

    image: Float64
    intrinsics: tuple[float, float, float, float]
    events: int


def pyramid(log_image: Float64, K: Float64, coarsest_px: float) -> Iterator[_Level]:
    """Reference views from a blur of about coarsest_px pixels down to the view itself.

    Each level is the one below it, blurred by a Gaussian of 1 px, at half the size by area.
    """
    images: list[Float64] = [log_image]
    while 2 ** len(images) <= 2 * coarsest_px and min(images[-1].shape) >= 2 * _COARSEST_PX:
        blurred = cv2.GaussianBlur(images[-1], (0, 0), 1.0, borderType=cv2.BORDER_REFLECT)
        half = (round(blurred.shape[1] / 2), round(blurred.shape[0] / 2))
        images.append(np.asarray(cv2.resize(blurred, half, interpolation=cv2.INTER_AREA)))
    for level in reversed(range(len(images))):
        image = images[level]
        scale = np.array([image.shape[1] / log_image.shape[1], image.shape[0] / log_image.shape[0]])
        if level > 0:
            image = image * gain(log_image, image)
        yield _Level(image, _intrinsics(np.diag([*scale, 1.0]) @ K), 2**level)


def gain(log_image: Float64, coarse: Float64) -> float:
    """Factor on a blurred view with which its gradient best predicts that of the view itself.

    It is the regression of the fine on the coarse gradient, at least 1. The other one, of the
    coarse on the fine, tells how much contrast the blur takes away. To take that off C instead
    looks the same, but what the blur hides then makes every path look too long, and the search ends
    millimetres beside the path.
    """
    size = (log_image.shape[1], log_image.shape[0])
    blurred = np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC))
    both, total = _gradient_products(blurred, log_image)
    return both / total if total > 0 else 1.0


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def _gradient_products(a, b):
    """Sums of grad a . grad b and of |grad a|^2 over two (h, w) images, by their differences.

    Added up row by row in one order: BLAS adds in another with every number of threads, and so the
    same events would end at another path on another machine.
    """
    height, width = a.shape
    both = total = 0.0
    for y in range(height):
        row_both = row_total = 0.0
        for x in range(width):
            if x + 1 < width:
                change = a[y, x + 1] - a[y, x]
                row_both += change * (b[y, x + 1] - b[y, x])
                row_total += change * change
            if y + 1 < height:
                change = a[y + 1, x] - a[y, x]
                row_both += change * (b[y + 1, x] - b[y, x])
                row_total += change * change
        both += row_both
        total += row_total
    return both, total


@dataclass(frozen=True, eq=False, slots=True)
class _Sum:
    """Robust cost at a path, its gradient and its Gauss-Newton Hessian, and events outside."""

    cost: float
    gradient: Float64
    hessian: Float64
    outside: int


def _accumulate(
    problem: _Problem, level: _Level, C: float, path: Trajectory, interval_us: int
) -> _Sum:
    R = np.ascontiguousarray(path.controls[:, :3, :3])
    p = np.ascontiguousarray(path.controls[:, :3, 3])
    turns = Rotation.from_matrix(R)
    omega = (turns[:-1].inv() * turns[1:]).as_rotvec()
    segment, table = cumulative_spline.tabulate(R, p, omega, interval_us, problem.seen_us)
    return _Sum(
        *normal_equations(
            problem.x,
            problem.y,
            problem.t_us,
            problem.t_before_us,
            problem.p,
            segment,
            table,
            len(R),
            problem.rays,
            level.image,
            level.intrinsics,
            *problem.reference,
            problem.plane,
            C,
            _HUBER_IN_C * C,
        )
    )


def _begun(sample: TrackingSample) -> tuple[Trajectory, float]:
    """A path without delay, without the finest detail; by how many pixels of the image it is off.

    It is the initial one where the search does not converge.
    """
    knots = _Knots.of(sample.initial)
    problem, failure = _problem(sample, knots.duration_us)
    if not failure:
        levels = list(pyramid(sample.log_image, sample.camera.K, _blur_px(sample)))
        coarse = levels[:-1] or levels
        path, _, _, converged = _search(problem, sample, sample.initial, knots, coarse)
        if converged:
            return path, _EXTRAPOLATION_PX
    return sample.initial, _blur_px(sample)


def _solve(
    problem: _Problem, sample: TrackingSample, path: Trajectory, knots: _Knots, blur_px: float
) -> tuple[Trajectory, TrackingDiagnostics, str]:
    """Search from coarse to fine; the path, how it went, and why it failed or ""."""
    levels = pyramid(sample.log_image, sample.camera.K, blur_px)
    path, state, passes, converged = _search(problem, sample, path, knots, levels)
    diagnostics = TrackingDiagnostics(
        state.cost / problem.residuals, passes, problem.residuals, state.outside
    )
    if not math.isfinite(state.cost):
        return path, diagnostics, "the cost is not finite"
    if state.outside > (1 - _LEAST_INSIDE) * problem.residuals:
        left = f"{state.outside} of {problem.residuals} events left the reference view"
        return path, diagnostics, left
    huber = _HUBER_IN_C * sample.contrast_threshold
    if diagnostics.cost >= huber * (sample.contrast_threshold - 0.5 * huber):
        return path, diagnostics, "explains the events no better than standing still"
    return path, diagnostics, "" if converged else f"no convergence in {passes} passes"


def _search(
    problem: _Problem,
    sample: TrackingSample,
    path: Trajectory,
    knots: _Knots,
    levels: Iterable[_Level],
) -> tuple[Trajectory, _Sum, int, bool]:
    """Go down from level to level: as `_levenberg_marquardt` on the last, with all passes."""
    passes, converged = 0, False
    state = _Sum(math.nan, np.empty(0), np.empty((0, 0)), 0)
    for level in levels:
        path, state, used, converged = _levenberg_marquardt(
            _joined(problem, level.events),
            level,
            sample.contrast_threshold,
            path,
            knots.interval_us,
            _distance_m(sample),
        )
        passes += used
    return path, state, passes, converged


def _levenberg_marquardt(
    problem: _Problem,
    level: _Level,
    C: float,
    path: Trajectory,
    interval_us: int,
    distance_m: float,
) -> tuple[Trajectory, _Sum, int, bool]:
    """Go down to a minimum: the path, its sum, passes over the events, whether it converged."""
    damping = 1e-3
    state = _accumulate(problem, level, C, path, interval_us)
    for passes in range(1, _MAX_PASSES):
        diagonal = np.diag(state.hessian)
        # A control pose that no event depends on stays where it is.
        floor = 1e-12 * diagonal.max()
        if not math.isfinite(state.cost) or floor == 0.0:
            return path, state, passes, False
        damped = state.hessian + np.diag(damping * diagonal + floor)
        step, solved = cholesky_solve(damped, -state.gradient)
        if not solved:
            damping = max(10.0 * damping, 1e-6)
            continue
        step = step.reshape(-1, 6)
        trial_path = _moved(path, step)
        trial = _accumulate(problem, level, C, trial_path, interval_us)
        moved_px = level.intrinsics[0] * math.sqrt(
            np.mean(np.sum(step[:, :3] ** 2, axis=1)) / distance_m**2
        )
        if trial.cost <= state.cost:
            # Noise lowers a sum of N squares at its minimum by its mean for each unknown.
            noise = len(state.gradient) * state.cost / problem.residuals
            small = state.cost - trial.cost < _CONVERGED_NOISE * noise
            path, state = trial_path, trial
            damping = max(0.2 * damping, 1e-9)
            if small or moved_px < _CONVERGED_PX:
                return path, state, passes + 1, True
        else:
            damping *= 8.0
            if moved_px < 1e-3 * _CONVERGED_PX:  # no step, however short, goes down
                return path, state, passes + 1, True
    return path, state, _MAX_PASSES, False


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def cholesky_solve(A, b):
    """Solve A x = b for a positive definite A; x, and whether A is that.

    LAPACK does it too, but splits large matrices, those of long paths, by its number of threads.

    Parameters
    ----------
    A
        (n, n), of which the upper half is read and overwritten by that of U, A = U^T U.
    b
        (n,), overwritten.
    """
    n = b.size
    for k in range(n):
        if not (A[k, k] > 0.0 and A[k, k] < np.inf):
            return b, False
        A[k, k:] /= math.sqrt(A[k, k])
        b[k] /= A[k, k]
        for i in range(k + 1, n):
            factor = A[k, i]
            b[i] -= factor * b[k]
            row, pivot = A[i, i:], A[k, i:]
            for j in range(n - i):
                row[j] -= factor * pivot[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
    return b, True


def _moved(path: Trajectory, step: Float64) -> Trajectory:
    """Move (M, 3) positions and turn (M, 3) rotations, on the left, of the control poses."""
    controls = path.controls.copy()
    controls[:, :3, 3] += step[:, :3]
    controls[:, :3, :3] = Rotation.from_rotvec(step[:, 3:]).as_matrix() @ controls[:, :3, :3]
    return Trajectory(path.knots_s, controls)


def _extended(path: Trajectory, knots: _Knots, by_us: int) -> Trajectory:
    """The path with more control poses, going on as it went on average.

    The last control pose is replaced too: the path hardly depends on it, so a search leaves it
    anywhere.
    """
    end_s, interval_s = path.duration_s, 1e-6 * knots.interval_us
    more = math.ceil(by_us / knots.interval_us)
    knots_s = interval_s * np.arange(-1.0, len(path.controls) + more - 1)
    share = (knots_s[len(path.controls) - 1 :, None] - end_s) / end_s
    first, last = path.pose(np.array([0.0, end_s]))
    turn = Rotation.from_matrix(last[:3, :3] @ first[:3, :3].T).as_rotvec()
    controls = np.tile(last, (len(share), 1, 1))
    controls[:, :3, 3] += share * (last[:3, 3] - first[:3, 3])
    controls[:, :3, :3] = Rotation.from_rotvec(share * turn).as_matrix() @ last[:3, :3]
    return Trajectory(knots_s, np.concatenate([path.controls[:-1], controls]))


def _delay_s(sample: TrackingSample, path: Trajectory) -> float:
    """When the path sees what the reference view shows, to 10 us."""
    t_s = np.arange(0, sample.max_delay_us + 1, 10) * 1e-6
    points_px = sample.camera.grid(9)
    H = plane_homography(sample.camera.K, sample.T_0, path.pose(t_s), sample.plane)
    off_px = map_pixels(H, points_px) - points_px
    return float(t_s[np.argmin(np.sum(off_px**2, axis=(1, 2)))])


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def normal_equations(
    x,  # (N,)
    y,  # (N,)
    t_us,  # (N,)
    t_before_us,  # (N,)
    p,  # (N,), or sums of several
    segment,  # (T,) and
    table,  # (T, 52), the spline at every event's microsecond, of `cumulative_spline.tabulate`
    controls,  # M
    rays,  # focal lengths and principal point of the sensor
    L,  # (h, w), L_l of Eq. (13)
    view,  # focal lengths and principal point of L, in its pixels
    R_0,  # (3, 3), T_0
    p_0,  # (3,)
    plane,  # (4,): n . X = offset
    C,
    huber,
):
    """Robust cost of Eq. (15), its gradient and its Gauss-Newton Hessian in the control poses.

    The cost is sum rho(r_k) with Huber's rho, r^2 / 2 up to `huber` and linear beyond. An event one
    of whose points is not in the reference view has no derivatives, and costs what a flat reference
    view would, rho(C), so that it does not pay to look away.

    Returns
    -------
    cost, gradient (6 M,), Hessian (6 M, 6 M), events outside
        Unknowns are each control pose's position, then its rotation, on the left.
    """
    fx, fy, cx, cy = rays
    view_fx, view_fy, view_cx, view_cy = view
    height, width = L.shape
    n_x, n_y, n_z, offset = plane
    gradient = np.zeros(6 * controls)
    H = np.zeros((6 * controls, 6 * controls))
    J = np.zeros(6 * controls)
    J_1, J_0 = np.zeros(24), np.zeros(24)
    cost, outside = 0.0, 0
    flat = 0.5 * C * C if huber >= C else huber * (C - 0.5 * huber)
    inside_1, L_1, s_1 = False, 0.0, 0
    for k in range(x.size):
        # The event before at this pixel is the one that was just done.
        inside_0, L_0, s_0 = inside_1, L_1, s_1
        J_0, J_1 = J_1, J_0

        # X = pi^-1(x, Z, K, T(t)): the ray m from p_t through the pixel meets the plane.
        T = table[t_us[k]]
        s_1 = segment[t_us[k]]
        ray_x, ray_y = (x[k] + 0.5 - cx) / fx, (y[k] + 0.5 - cy) / fy
        m_x = T[0] * ray_x + T[1] * ray_y + T[2]
        m_y = T[3] * ray_x + T[4] * ray_y + T[5]
        m_z = T[6] * ray_x + T[7] * ray_y + T[8]
        towards = n_x * m_x + n_y * m_y + n_z * m_z
        Z = (offset - n_x * T[9] - n_y * T[10] - n_z * T[11]) / towards
        X_x = T[9] + Z * m_x - p_0[0]
        X_y = T[10] + Z * m_y - p_0[1]
        X_z = T[11] + Z * m_z - p_0[2]

        # x' = pi(X, K, T_0)
        Y_x = R_0[0, 0] * X_x + R_0[1, 0] * X_y + R_0[2, 0] * X_z
        Y_y = R_0[0, 1] * X_x + R_0[1, 1] * X_y + R_0[2, 1] * X_z
        Y_z = R_0[0, 2] * X_x + R_0[1, 2] * X_y + R_0[2, 2] * X_z
        u, v = view_fx * Y_x / Y_z + view_cx, view_fy * Y_y / Y_z + view_cy
        inside_1 = (
            Z > 0.0
            and Y_z > 0.0
            and u >= 0.5
            and u <= width - 0.5
            and v >= 0.5
            and v <= height - 0.5
        )
        if inside_1:
            L_1, L_u, L_v = bicubic.sample(L, u, v)
            # dL/dX in the reference camera, g in the world
            d_x, d_y = L_u * view_fx / Y_z, L_v * view_fy / Y_z
            d_z = -(d_x * Y_x + d_y * Y_y) / Y_z
            g_x = R_0[0, 0] * d_x + R_0[0, 1] * d_y + R_0[0, 2] * d_z
            g_y = R_0[1, 0] * d_x + R_0[1, 1] * d_y + R_0[1, 2] * d_z
            g_z = R_0[2, 0] * d_x + R_0[2, 1] * d_y + R_0[2, 2] * d_z
            # X moves with p_t along the plane, by I - m n^T / (n . m): q = dL/dp_t
            along = (g_x * m_x + g_y * m_y + g_z * m_z) / towards
            q_x, q_y, q_z = g_x - along * n_x, g_y - along * n_y, g_z - along * n_z
            # and by Z times that for a change delta x m of the ray: dL/ddelta = Z m x q
            w_x = Z * (m_y * q_z - m_z * q_y)
            w_y = Z * (m_z * q_x - m_x * q_z)
            w_z = Z * (m_x * q_y - m_y * q_x)
            for c in range(4):
                B, D = T[12 + c], T[16 + 9 * c : 25 + 9 * c]
                J_1[6 * c] = B * q_x
                J_1[6 * c + 1] = B * q_y
                J_1[6 * c + 2] = B * q_z
                J_1[6 * c + 3] = w_x * D[0] + w_y * D[3] + w_z * D[6]
                J_1[6 * c + 4] = w_x * D[1] + w_y * D[4] + w_z * D[7]
                J_1[6 * c + 5] = w_x * D[2] + w_y * D[5] + w_z * D[8]

        if t_before_us[k] < 0:
            continue
        if not (inside_0 and inside_1):
            outside += 1
            cost += flat
            continue
        r = L_1 - L_0 - p[k] * C  # Eq. (14) times p_k
        size = abs(r)
        if size <= huber:
            weight = 1.0
            cost += 0.5 * r * r
        else:
            weight = huber / size
            cost += huber * (size - 0.5 * huber)
        # Only control poses from the first of the earlier event's to the last of this one's count.
        first, count = 6 * s_0, 6 * (s_1 - s_0) + 24
        J[:count] = 0.0
        for i in range(24):
            J[count - 24 + i] = J_1[i]
        for i in range(24):
            J[i] -= J_0[i]
        for i in range(count):
            J_i = weight * J[i]
            gradient[first + i] += J_i * r
            row = H[first + i, first : first + count]
            for j in range(count):  # whole rows: twice the sums of a half, in half its time
                row[j] += J_i * J[j]
    for i in range(6 * controls):
        for j in range(i):
            H[i, j] = H[j, i]
    return cost, gradient, H, outside
