"""Event-based Photometric Flow (EPF), Eqs. (9) to (12).

Log intensity changed by p C between an event and the previous one at its pixel. The flow and the
image at the window's start predict that change, Eq. (10); least squares finds the flow.

The paper substitutes the best C of Eq. (12) into the objective before it minimizes over v. The
result is the variance of p Delta L, which is 0 at v = 0, where every Delta L is 0: zero motion
explains any events perfectly. So C is known here, as it is in simulation. If it is unknown, the
scale-free form is minimized: the variance over C^2, rescaled,

    min over C of  mean (p Delta L / C - 1)^2  =  1 - mean(p Delta L)^2 / mean((p Delta L)^2).

It has its largest value, 1, at v = 0, as C is bounded from below.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tasks.flow import REACH_SIGMAS, FlowEstimate, FlowSample
from tasks.numerics import bicubic
from tasks.numerics.compiling import jit, jit_contract

Float64 = NDArray[np.float64]

MIN_EVENTS = 10
CONTRAST_BOUNDS = (0.02, 2.0)  # log units; sensors have 0.1 to 0.5
DELAY_BOUNDS = (0.0, 1.0)  # windows: an event cannot come before its light
_MAX_STEPS = 1000  # fine texture and a slow sensor need 100 to 300
_CONVERGED_PX = 1e-3
_DESCENT_STEPS = 200  # of steepest descent
_FIRST_STEP_PX = 0.25
_FLAT = 1e-9  # 1/px: a gradient of that share of the cost is rounding
_TOGETHER = 512  # events that are sampled at once


def estimate(sample: FlowSample) -> FlowEstimate:
    """Find the flow that best explains the changes between consecutive events of each pixel.

    Levenberg-Marquardt in two unknowns on Eq. (11), with C known. Only events with an earlier one
    at their pixel in this window have a residual. An answer more than 4 sigma from the initial flow
    is a failure: the search has run away.
    """
    return _estimate(sample, _levenberg_marquardt)


def estimate_unknown_contrast(sample: FlowSample) -> FlowEstimate:
    """As `estimate`, with C as a third unknown in the scale-free objective."""
    return _estimate(sample, _levenberg_marquardt, contrast_is_known=False)


def estimate_by_descent(sample: FlowSample) -> FlowEstimate:
    """As `estimate_unknown_contrast`, by steepest descent over the flow, with the best C at each.

    The paper uses a first-order method, but does not say which one.
    """
    return _estimate(sample, _steepest_descent, contrast_is_known=False)


def estimate_with_delay(sample: FlowSample) -> FlowEstimate:
    """As `estimate`, with a delay that all events share as a third unknown.

    A sensor with two poles at a = 2 pi f_cutoff delays slow changes by 2 / a.
    """
    return _estimate(sample, _levenberg_marquardt, has_delay=True)


# From events, log image, start, lower and upper bounds to the unknowns, and whether it converged.
_Search = Callable[..., tuple[Float64, bool]]


def _estimate(
    sample: FlowSample, search: _Search, *, contrast_is_known: bool = True, has_delay: bool = False
) -> FlowEstimate:
    usable = np.isfinite(sample.t_before)
    if usable.sum() < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{usable.sum()} events with one before them")
    columns = np.stack([sample.x_px, sample.y_px, sample.t, sample.t_before, sample.p], axis=1)
    events = columns[_by_pixel(sample, usable)]
    low_C, high_C = CONTRAST_BOUNDS
    if contrast_is_known:
        low_C = high_C = sample.contrast_threshold
    lower = np.array([-np.inf, -np.inf, 1 / high_C, DELAY_BOUNDS[0]])
    upper = np.array([np.inf, np.inf, 1 / low_C, DELAY_BOUNDS[1] if has_delay else 0.0])
    start = np.array([*sample.initial, 1 / low_C, 0.0])
    if not contrast_is_known:
        start[2] = np.clip(_best_gain(events, sample.log_image, start), lower[2], upper[2])
    unknowns, converged = search(events, sample.log_image, start, lower, upper)
    if not converged:
        return FlowEstimate(sample.initial, "no convergence")
    if np.abs(unknowns[:2] - sample.initial).max() > REACH_SIGMAS * sample.initial_sigma_px:
        return FlowEstimate(sample.initial, "search ended beyond its bound")
    return FlowEstimate(unknowns[:2], delay=float(unknowns[3]))


def _by_pixel(sample: FlowSample, usable: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the indices of usable events, sorted by pixel, then by time."""
    chosen = np.flatnonzero(usable)
    (left, top), (right, bottom) = sample.patch
    row, column = sample.y_px[chosen].astype(int) - top, sample.x_px[chosen].astype(int) - left
    pixel = row * (right - left) + column
    size = (right - left) * (bottom - top)
    return chosen[np.argsort(pixel.astype(np.min_scalar_type(size)), kind="stable")]


def _best_gain(events: Float64, L: Float64, unknowns: Float64) -> float:
    """Return 1 / C of least cost at a flow: Eq. (12) for the scale-free objective.

    The cost is a parabola in 1 / C, so one Newton step from any point finds its vertex.
    """
    _, gradient, curvature = normal_equations(events, L, unknowns)
    steepness = curvature[2, 2]
    return float(unknowns[2] - gradient[2] / steepness) if 0 < steepness < np.inf else np.inf


def _steepest_descent(
    events: Float64, L: Float64, start: Float64, lower: Float64, upper: Float64
) -> tuple[Float64, bool]:
    """Return the unknowns at which steps against the gradient end, and whether there is a gradient.

    The step length doubles after a step that lowers the cost, and halves otherwise.
    """

    def at(flow: Float64) -> tuple[Float64, float, Float64]:
        unknowns = np.array([*flow, start[2], 0.0])
        unknowns[2] = np.clip(_best_gain(events, L, unknowns), lower[2], upper[2])
        cost, gradient, _ = normal_equations(events, L, unknowns)
        return unknowns, cost, gradient[:2]

    best, cost, gradient = at(start[:2])
    if not math.isfinite(cost) or (cost > 0 and np.hypot(*gradient) <= _FLAT * cost):
        return best, False
    step_px = _FIRST_STEP_PX
    for _ in range(_DESCENT_STEPS):
        slope = np.hypot(*gradient)
        if step_px < _CONVERGED_PX or slope == 0:
            break
        trial = at(best[:2] - step_px * gradient / slope)
        if trial[1] < cost:
            best, cost, gradient = trial
            step_px *= 2
        else:
            step_px /= 2
    return best, True


@jit_contract
def normal_equations(events, L, unknowns):
    """Sum up the cost |p Delta L(v) / C - 1|^2 of Eq. (11) and its derivatives.

    Delta L_k(v) = L(x_k - v t_k) - L(x_k - v (t_k - Delta t_k)), Eq. (10); with a delay d, t_k - d
    replaces t_k. Consecutive rows with consecutive events of a pixel share a point, which is
    sampled once.

    Parameters
    ----------
    events
        (N, 5): x, y, t, time of the previous event at the pixel, p; fastest if sorted by pixel.
    L
        (h, w) float64, log intensity at the window's start.
    unknowns
        (4,): v_x, v_y, 1 / C and d.

    Returns
    -------
    Cost, half its gradient (4,), and J^T J (4, 4).
    """
    vx, vy, gain, delay = unknowns
    cost = 0.0
    gradient = np.zeros(4)
    curvature = np.zeros((4, 4))
    x, y, t = np.empty(2 * _TOGETHER), np.empty(2 * _TOGETHER), np.empty(2 * _TOGETHER)
    light = np.empty((3, 2 * _TOGETHER))
    points = np.empty(_TOGETHER, np.uint64)  # of each event; the previous event's is one before
    for start in range(0, events.shape[0], _TOGETHER):
        block = events[start : start + _TOGETHER]
        count = 0
        for k in range(block.shape[0]):
            follows = (
                k > 0
                and block[k, 3] == block[k - 1, 2]
                and block[k, 0] == block[k - 1, 0]
                and block[k, 1] == block[k - 1, 1]
            )
            if not follows:
                t[count] = block[k, 3] - delay
                x[count], y[count] = block[k, 0] - vx * t[count], block[k, 1] - vy * t[count]
                count += 1
            t[count] = block[k, 2] - delay
            x[count], y[count] = block[k, 0] - vx * t[count], block[k, 1] - vy * t[count]
            points[k] = count
            count += 1
        bicubic.sample_all(L, x[:count], y[:count], light)
        for k in range(block.shape[0]):
            now, before = points[k], points[k] - np.uint64(1)
            t1, L1, L1x, L1y = t[now], light[0, now], light[1, now], light[2, now]
            t0, L0, L0x, L0y = t[before], light[0, before], light[1, before], light[2, before]
            p = block[k, 4]
            step = p * (L1 - L0)
            r = gain * step - 1.0
            slopes = (
                gain * p * (t0 * L0x - t1 * L1x),
                gain * p * (t0 * L0y - t1 * L1y),
                step,
                gain * p * (vx * (L1x - L0x) + vy * (L1y - L0y)),
            )
            cost += r * r
            for i in range(4):
                gradient[i] += slopes[i] * r
                for j in range(i + 1):
                    curvature[i, j] += slopes[i] * slopes[j]
    for i in range(4):
        for j in range(i):
            curvature[j, i] = curvature[i, j]
    return cost, gradient, curvature


@jit
def _levenberg_marquardt(events, L, start, lower, upper):
    """Return the unknowns of the least cost within bounds, and whether the search converged."""
    unknowns = start.copy()
    damping = 1e-3
    cost, gradient, curvature = normal_equations(events, L, unknowns)
    for _ in range(_MAX_STEPS):
        # An unknown at its bound stays there if the step would cross the bound.
        held = ((unknowns <= lower) & (gradient >= 0)) | ((unknowns >= upper) & (gradient <= 0))
        step, solved = _damped_step(curvature, gradient, held, damping)
        if not solved:
            return unknowns, False
        trial = np.minimum(np.maximum(unknowns + step, lower), upper)
        trial_cost, trial_gradient, trial_curvature = normal_equations(events, L, trial)
        if trial_cost <= cost:
            moved = trial - unknowns
            speed = np.hypot(trial[0], trial[1])
            relative = max(abs(moved[2]) / trial[2], abs(moved[3]))
            unknowns, cost = trial, trial_cost
            gradient, curvature = trial_gradient, trial_curvature
            damping = max(damping * 0.3, 1e-9)
            if max(np.hypot(moved[0], moved[1]), speed * relative) < _CONVERGED_PX:
                return unknowns, True
        else:
            damping *= 5.0
            if damping > 1e9:  # no step, however short, lowers the cost: this is the minimum
                return unknowns, True
    return unknowns, False


@jit
def _damped_step(curvature, gradient, held, damping):
    """Solve (J^T J + damping diag) step = -gradient for the free unknowns, by elimination."""
    n = gradient.size
    A, b = curvature.copy(), -gradient
    for i in range(n):
        A[i, i] *= 1.0 + damping
        if held[i]:
            A[i, :] = 0.0
            A[:, i] = 0.0
            A[i, i] = 1.0
            b[i] = 0.0
    for i in range(n):
        if not A[i, i] > 0.0:
            return b, False
        for j in range(i + 1, n):
            factor = A[j, i] / A[i, i]
            for k in range(n):  # an assignment of rows compiles slowly
                A[j, k] -= factor * A[i, k]
            b[j] -= factor * b[i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
    return b, True
