"""The robust sum of squares of a path, Eq. (15), with its derivatives in the control poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render import Trajectory
from tasks.methods.photometric_tracking.reference_views import Level
from tasks.methods.photometric_tracking.residuals import Float64, Problem
from tasks.numerics import bicubic, cumulative_spline
from tasks.numerics.compiling import jit_contract

HUBER_IN_C = 0.5


class Spline(NamedTuple):
    """A path at each microsecond, from `cumulative_spline.tabulate`."""

    segment: NDArray[np.int64]  # (T,)
    table: Float64  # (T, 52)
    controls: int  # M, number of control poses


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
    """Sum up the residuals of a problem at a path."""
    C = problem.contrast_threshold
    R = np.ascontiguousarray(path.controls[:, :3, :3])
    p = np.ascontiguousarray(path.controls[:, :3, 3])
    turns = Rotation.from_matrix(R)
    omega = (turns[:-1].inv() * turns[1:]).as_rotvec()
    segment, table = cumulative_spline.tabulate(R, p, omega, problem.interval_us, problem.seen_us)
    spline, loss = Spline(segment, table, len(R)), Loss(C, HUBER_IN_C * C)
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
        The `PixelEvents` and the `Geometry` of a problem.
    spline
        The `Spline` at the time of each event.
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
    rays, R_0, p_0, plane = geometry
    segment, table, controls = spline
    L = level.image
    C, huber = loss
    fx, fy, cx, cy = rays
    view_fx, view_fy, view_cx, view_cy = level.intrinsics
    height, width = L.shape
    n_x, n_y, n_z, offset = plane
    gradient = np.zeros(6 * controls)
    H = np.zeros((6 * controls, 6 * controls))
    J = np.zeros(6 * controls)
    J_1, J_0 = np.zeros(24), np.zeros(24)
    cost, outside = 0.0, 0
    inside_1, L_1, s_1 = False, 0.0, 0
    for k in range(x.size):
        # The previous event at this pixel is the one before in the arrays.
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
        inside_1 = Z > 0.0 and Y_z > 0.0 and 0.5 <= u <= width - 0.5 and 0.5 <= v <= height - 0.5
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
        inside = inside_0 and inside_1
        r = (L_1 - L_0 if inside else 0.0) - p[k] * C  # Eq. (14) times p_k
        size = abs(r)
        if size <= huber:
            weight = 1.0
            cost += 0.5 * r * r
        else:
            weight = huber / size
            cost += huber * (size - 0.5 * huber)
        if not inside:
            outside += 1
            continue
        # Only the control poses of the segments from the earlier event's to this one's matter.
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
            for j in range(count):  # whole rows take half the time of half rows
                row[j] += J_i * J[j]
    for i in range(6 * controls):
        for j in range(i):
            H[i, j] = H[j, i]
    return cost, gradient, H, outside
