"""The robust sum of squares of a path, Eq. (15), with its derivatives in the control poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from eres_render import Trajectory
from tasks.methods.photometric_tracking.reference_views import Level
from tasks.methods.photometric_tracking.residuals import Float64, Problem
from tasks.numerics import bicubic, cumulative_spline
from tasks.numerics.compiling import inlined, jit_contract, jit_contract_in_place
from tasks.numerics.vectors import cross, dot, mixed, rows_of, times, transposed_times

HUBER_IN_C = 0.5
_TOGETHER = 64  # residuals at a time


class Spline(NamedTuple):
    """The control poses of a path, as `cumulative_spline.segment_after` takes them."""

    R: Float64  # (M, 3, 3)
    p: Float64  # (M, 3)
    omega: Float64  # (M - 1, 3)
    interval_us: int  # from knot to knot


class Loss(NamedTuple):
    """Huber's rho of Eq. (15): r^2 / 2 up to a bound, linear beyond; log units."""

    C: float
    bound: float


class RobustSum(NamedTuple):
    """Robust cost of a path, with (6 M,) gradient and Gauss-Newton Hessian in M control poses."""

    cost: float
    gradient: Float64
    hessian: Float64
    outside: int


def accumulate(problem: Problem, level: Level, path: Trajectory) -> RobustSum:
    """Sum up the residuals of a problem of `residuals.join_events` at a path."""
    C = problem.contrast_threshold
    R = np.ascontiguousarray(path.controls[:, :3, :3])
    p = np.ascontiguousarray(path.controls[:, :3, 3])
    turns = Rotation.from_matrix(R)
    omega = (turns[:-1].inv() * turns[1:]).as_rotvec()
    spline, loss = Spline(R, p, omega, problem.interval_us), Loss(C, HUBER_IN_C * C)
    return RobustSum(*normal_equations(problem.events, problem.geometry, spline, level, loss))


@jit_contract
def normal_equations(events, geometry, spline, level, loss):
    """Sum up the robust cost of Eq. (15) and its derivatives in the control poses.

    The cost is sum rho(r_k). An event that sees a point outside the reference view has no
    derivatives, and costs rho(p C), as in a flat reference view, so that the search gains nothing
    by looking away.

    Parameters
    ----------
    events, geometry
        The `PixelEvents` and the `Geometry` of a problem. Each event has one before it at its
        pixel. Those between the same two segments of the path are together.
    spline
        The `Spline`.
    level
        The `Level`; its image is L_l of Eq. (13).
    loss
        The `Loss` of a residual.

    Returns
    -------
    cost, gradient (6 M,), Hessian (6 M, 6 M), events outside
        Unknowns are each control pose's position, then its rotation, on the left.
    """
    x, y, t_us, t_before_us, p = events
    R, positions, omega, interval_us = spline
    unknowns = 6 * len(R)
    gradient, H = np.zeros(unknowns), np.zeros((unknowns, unknowns))
    # Loops over the last axis are vectorized, which takes constant shapes.
    u, weights = np.empty(_TOGETHER), np.empty((12, _TOGETHER))
    projections, samples = np.empty((2, 11, _TOGETHER)), np.empty((2, 3, _TOGETHER))
    q, w, J = np.empty((3, _TOGETHER)), np.empty((3, _TOGETHER)), np.empty((2, 24, _TOGETHER))
    rows, factors = np.zeros(_TOGETHER * 48), np.empty((2, _TOGETHER))
    g, G = np.empty(48), np.empty(48 * 48)
    cost, outside, end = 0.0, 0, 0
    while end < x.size:
        start, s_0, s_1 = end, t_before_us[end] // interval_us, t_us[end] // interval_us
        while end < x.size and (
            t_before_us[end] // interval_us == s_0 and t_us[end] // interval_us == s_1
        ):
            end += 1
        g[:], G[:] = 0.0, 0.0
        for first in range(start, end, _TOGETHER):
            n = min(_TOGETHER, end - first)
            for side in range(2):
                s, t = (s_1, t_us[first:]) if side else (s_0, t_before_us[first:])
                segment = cumulative_spline.segment_after(R, positions, omega, s)
                for k in range(n):
                    u[k] = t[k] / interval_us - s
                cumulative_spline.weigh(n, u, segment, weights)
                projection = projections[side]
                _project(n, x[first:], y[first:], weights, segment, geometry, level, projection)
                column, row = projection[0, :n], projection[1, :n]
                bicubic.sample_all(level.image, column, row, samples[side, :, :n])
                _differentiate(n, samples[side], projection, geometry, level, q, w)
                cumulative_spline.pull_back(n, weights, segment, q, w, J[side])
            used, cost_of_these = _residuals(
                n, p[first:], projections, samples, J, loss, rows, factors
            )
            cost += cost_of_these
            outside += n - used
            _add(used, rows, factors, g, G)
        _spread(g, G, s_0, s_1, gradient, H)
    return cost, gradient, H, outside


@inlined
def _project(n, x, y, weights, segment, geometry, level, projection):
    """Project n pixels into the reference view, at the times of some weights.

    `projection` (11, N) gets the point in the reference view, px, and whether the pixel sees it;
    then the ray m, n . m, Z, and the point in the reference camera.
    """
    (fx, fy, cx, cy), R_0, p_0, (n_x, n_y, n_z, offset) = geometry
    view_fx, view_fy, view_cx, view_cy = level.intrinsics
    height, width = level.image.shape
    normal, origin, R = (n_x, n_y, n_z), (p_0[0], p_0[1], p_0[2]), rows_of(R_0)
    m = projection[3:6]
    # X = pi^-1(x, Z, K, T(t)): the ray m from p_t through the pixel meets the plane.
    for k in range(n):
        m[0, k], m[1, k], m[2, k] = (x[k] + 0.5 - cx) / fx, (y[k] + 0.5 - cy) / fy, 1.0
    cumulative_spline.turn(n, weights, segment, m)
    for k in range(n):
        ray = m[0, k], m[1, k], m[2, k]
        p_t = cumulative_spline.position(weights, k, segment)
        towards = dot(normal, ray)
        Z = (offset - dot(normal, p_t)) / towards
        # x' = pi(X, K, T_0)
        Y_x, Y_y, Y_z = transposed_times(R, mixed(1.0, p_t, Z, ray, -1.0, origin))
        a, b = view_fx * Y_x / Y_z + view_cx, view_fy * Y_y / Y_z + view_cy
        inside = (Z > 0.0) & (Y_z > 0.0) & (a >= 0.5) & (a <= width - 0.5)
        inside &= (b >= 0.5) & (b <= height - 0.5)
        projection[0, k], projection[1, k] = (a, b) if inside else (0.5, 0.5)
        projection[2, k] = inside
        projection[6, k], projection[7, k] = towards, Z
        projection[8, k], projection[9, k], projection[10, k] = Y_x, Y_y, Y_z


@inlined
def _differentiate(n, sample, projection, geometry, level, q, w):
    """Write the derivatives in the pose of n values of the reference view, at a projection.

    q (3, N) are those in p_t, and w (3, N) those in a turn of the ray, on the left.
    """
    _, R_0, _, (n_x, n_y, n_z, _) = geometry
    view_fx, view_fy, _, _ = level.intrinsics
    R = rows_of(R_0)
    for k in range(n):
        ray, towards, Z = (
            (projection[3, k], projection[4, k], projection[5, k]),
            projection[6, k],
            projection[7, k],
        )
        Y_x, Y_y, Y_z = projection[8, k], projection[9, k], projection[10, k]
        # dL/dX in the reference camera, g in the world
        d_x, d_y = sample[1, k] * view_fx / Y_z, sample[2, k] * view_fy / Y_z
        g = times(R, (d_x, d_y, -(d_x * Y_x + d_y * Y_y) / Y_z))
        # X moves with p_t along the plane, by I - m n^T / (n . m): q = dL/dp_t
        along = dot(g, ray) / towards
        q_x, q_y, q_z = g[0] - along * n_x, g[1] - along * n_y, g[2] - along * n_z
        q[0, k], q[1, k], q[2, k] = q_x, q_y, q_z
        # and by Z times that for a change delta x m of the ray: dL/ddelta = Z m x q
        w_x, w_y, w_z = cross(ray, (q_x, q_y, q_z))
        w[0, k], w[1, k], w[2, k] = Z * w_x, Z * w_y, Z * w_z


@jit_contract_in_place
def _residuals(n, p, projections, samples, J, loss, rows, factors):
    """Write a row of derivatives, 48, and w and w r, for each residual that has derivatives.

    `projections`, `samples` and `J` are of the two events of n residuals, the earlier first.
    Returns how many rows there are, and the cost of all n.
    """
    C, huber = loss
    cost, used = 0.0, 0
    for k in range(n):
        inside = projections[0, 2, k] + projections[1, 2, k] == 2.0
        r = (samples[1, 0, k] - samples[0, 0, k] if inside else 0.0) - p[k] * C
        size = abs(r)  # Eq. (14) times p_k
        cost += 0.5 * r * r if size <= huber else huber * (size - 0.5 * huber)
        if inside:
            for i in range(24):
                rows[48 * used + i] = -J[0, i, k]
                rows[48 * used + 24 + i] = J[1, i, k]
            weight = 1.0 if size <= huber else huber / size
            factors[0, used], factors[1, used] = weight, weight * r
            used += 1
    return used, cost


@jit_contract_in_place
def _add(n, rows, factors, g, G):
    """Add n rows J (48,) to the sums of w r J and of w J J^T, whose upper half is written.

    The factors of a row are w and w r. Four rows at a time read and write the sums once.
    """
    for first in range(0, n, 4):
        for k in range(n, first + 4):
            factors[0, k] = factors[1, k] = 0.0
        J = rows[48 * first :]
        for i in range(48):
            a, b, c, d = J[i], J[48 + i], J[96 + i], J[144 + i]
            f = factors[1, first:]
            g[i] += f[0] * a + f[1] * b + f[2] * c + f[3] * d
            f = factors[0, first:]
            a, b, c, d = f[0] * a, f[1] * b, f[2] * c, f[3] * d
            # The trip counts are constants, so that no rest is left of a vectorized loop.
            if i < 24:
                for j in range(48):
                    G[48 * i + j] += a * J[j] + b * J[48 + j] + c * J[96 + j] + d * J[144 + j]
            else:
                for j in range(24, 48):
                    G[48 * i + j] += a * J[j] + b * J[48 + j] + c * J[96 + j] + d * J[144 + j]


@jit_contract_in_place
def _spread(g, G, s_0, s_1, gradient, H):
    """Add the sums of residuals between two segments to those of all unknowns."""
    for i in range(48):
        row = 6 * s_0 + i if i < 24 else 6 * s_1 + i - 24
        gradient[row] += g[i]
        for j in range(48):
            column = 6 * s_0 + j if j < 24 else 6 * s_1 + j - 24
            H[row, column] += G[48 * min(i, j) + max(i, j)]
