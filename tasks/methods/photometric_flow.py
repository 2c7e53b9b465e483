"""Event-based Photometric Flow (EPF), Eqs. (9) to (12), with the contrast threshold known.

The paper substitutes the best C into the objective before it minimises over v. That objective is 0
at v = 0, where every difference of brightness is 0 and so is the best C: standing still explains
any events perfectly. In simulation C is known, and is used. Where it is not, the same objective
divided by C^2, its scale-free form, does not reward standing still.
"""

from __future__ import annotations

import numba
import numpy as np

from tasks.flow import FlowEstimate, FlowSample
from tasks.methods import bicubic

MIN_EVENTS = 10
_MAX_STEPS = 60
_CONVERGED_PX = 1e-4


def estimate(sample: FlowSample) -> FlowEstimate:
    """Flow that best explains the brightness steps between consecutive events of each pixel.

    Levenberg-Marquardt in two unknowns on Eq. (11) with C known. Only events with one before them
    at their pixel in this window have a residual.
    """
    usable = np.isfinite(sample.t_before)
    if usable.sum() < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{usable.sum()} events with one before them")
    events = np.stack([sample.x_px, sample.y_px, sample.t, sample.t_before, sample.p])[:, usable]
    v, converged = _levenberg_marquardt(
        np.ascontiguousarray(events), sample.log_image, sample.contrast_threshold, sample.initial
    )
    if not converged:
        return FlowEstimate(sample.initial, "no convergence")
    return FlowEstimate(v)


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def normal_equations(events, L, C, vx, vy):
    """Cost |Delta L(v) p - C|^2, half its gradient and J^T J at v, Eq. (11).

    Delta L_k(v) = L(x_k - v t_k) - L(x_k - v (t_k - Delta t_k)), Eq. (10).
    """
    cost, gx, gy, hxx, hxy, hyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(events.shape[1]):
        x, y, t, t_before, p = events[0, k], events[1, k], events[2, k], events[3, k], events[4, k]
        L1, L1x, L1y = bicubic.sample(L, x - vx * t, y - vy * t)
        L0, L0x, L0y = bicubic.sample(L, x - vx * t_before, y - vy * t_before)
        r = p * (L1 - L0) - C
        jx = p * (t_before * L0x - t * L1x)
        jy = p * (t_before * L0y - t * L1y)
        cost += r * r
        gx += jx * r
        gy += jy * r
        hxx += jx * jx
        hxy += jx * jy
        hyy += jy * jy
    return cost, gx, gy, hxx, hxy, hyy


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _levenberg_marquardt(events, L, C, initial):
    vx, vy = initial[0], initial[1]
    damping = 1e-3
    cost, gx, gy, hxx, hxy, hyy = normal_equations(events, L, C, vx, vy)
    for _ in range(_MAX_STEPS):
        axx, ayy = hxx * (1.0 + damping), hyy * (1.0 + damping)
        determinant = axx * ayy - hxy * hxy
        if not determinant > 0.0:
            return np.array([vx, vy]), False
        step_x = -(ayy * gx - hxy * gy) / determinant
        step_y = -(axx * gy - hxy * gx) / determinant
        trial = normal_equations(events, L, C, vx + step_x, vy + step_y)
        if trial[0] <= cost:
            vx += step_x
            vy += step_y
            cost, gx, gy, hxx, hxy, hyy = trial
            damping = max(damping * 0.3, 1e-9)
            if step_x * step_x + step_y * step_y < _CONVERGED_PX**2:
                return np.array([vx, vy]), True
        else:
            damping *= 5.0
            if damping > 1e9:  # no step, however short, goes down: this is the minimum
                return np.array([vx, vy]), True
    return np.array([vx, vy]), False
