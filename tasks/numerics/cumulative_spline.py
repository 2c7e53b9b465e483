"""The cumulative cubic B-spline at many times, with derivatives by its control poses, jitted.

The spline is that of `eres_render.Trajectory` with evenly spaced knots, split SO(3) x R^3 (Mueggler
et al., "Continuous-Time Visual-Inertial Odometry for Event Cameras", T-RO 2018, eq. 5):

    R(t) = R_0 Exp(B_1 Omega_1) Exp(B_2 Omega_2) Exp(B_3 Omega_3)
    p(t) = p_0 + B_1 (p_1 - p_0) + B_2 (p_2 - p_1) + B_3 (p_3 - p_2)

with Omega_j the rotation vector from control pose j - 1 to j, and control poses counted from the
first of the four that determine the pose at t. Rotations are perturbed on the left, in the world:
R <- Exp(delta) R. The derivatives are those of Sommer et al., "Efficient Derivative Computation for
Cumulative B-Splines on Lie Groups" (CVPR 2020), for that side.
"""

from __future__ import annotations

import math

import numpy as np

from tasks.numerics.compiling import jit_contract

COLUMNS = 52
"""Columns of a row of `tabulate`: R (9), p (3), 4 weights of positions, 4 (3, 3) of rotations."""


@jit_contract
def _coefficients(squared):
    """Return sin(a) / a, (1 - cos(a)) / a^2, (a - sin(a)) / a^3 for a^2, by series near 0."""
    if squared < 1e-4:
        return (
            1.0 - squared / 6.0 * (1.0 - squared / 20.0),
            0.5 - squared / 24.0 * (1.0 - squared / 30.0),
            1.0 / 6.0 - squared / 120.0 * (1.0 - squared / 42.0),
        )
    angle = math.sqrt(squared)
    return (
        math.sin(angle) / angle,
        (1.0 - math.cos(angle)) / squared,
        (angle - math.sin(angle)) / (squared * angle),
    )


@jit_contract
def _polynomial(x, y, z, a0, a1, a2, out):
    """Write a0 I + a1 [w] + a2 [w]^2 into out, where [w] is the cross product with (x, y, z)."""
    out[0, 0] = a0 - a2 * (y * y + z * z)
    out[1, 1] = a0 - a2 * (x * x + z * z)
    out[2, 2] = a0 - a2 * (x * x + y * y)
    out[0, 1] = a2 * x * y - a1 * z
    out[1, 0] = a2 * x * y + a1 * z
    out[0, 2] = a2 * x * z + a1 * y
    out[2, 0] = a2 * x * z - a1 * y
    out[1, 2] = a2 * y * z - a1 * x
    out[2, 1] = a2 * y * z + a1 * x


@jit_contract
def _inverse_left_jacobian(omega, out):
    """Write J_l^-1 of a rotation vector: Exp(e) Exp(w) = Exp(w + J_l^-1(w) e)."""
    x, y, z = omega[0], omega[1], omega[2]
    squared = x * x + y * y + z * z
    a, b, _ = _coefficients(squared)
    c = 1.0 / 12.0 + squared / 720.0 if squared < 1e-4 else (1.0 - 0.5 * a / b) / squared
    _polynomial(x, y, z, 1.0, -0.5, c, out)


@jit_contract
def _multiply(A, B, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@jit_contract
def tabulate(R, p, omega, interval_us, wanted):
    """Compute the spline at the requested microseconds of its duration.

    Parameters
    ----------
    R, p
        (M, 3, 3), (M, 3): rotations and positions of the control poses.
    omega
        (M - 1, 3): rotation vectors of `R[j].T @ R[j + 1]`.
    interval_us
        Microseconds from knot to knot.
    wanted
        (T,) bool, one for each microsecond of at most M - 3 intervals. Rows that are not wanted are
        not initialized.

    Returns
    -------
    segment
        (T,) int64: the first of the four control poses that determine the pose.
    table
        (T, 52) float64: R(t) row by row, p(t), then for each of the four the weight w with
        dp(t) = w dp_c, then for each the (3, 3) matrix D with delta(t) = D delta_c.
    """
    segment = np.empty(wanted.size, np.int64)
    table = np.empty((wanted.size, COLUMNS))
    before = np.empty((3, 3, 3))  # J_l^-1(Omega_j) R_(j-1)^T of the segment
    J, A, M, B = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    S, next_S = np.empty((3, 3)), np.empty((3, 3))
    current = -1
    # Entry by entry: views and array expressions would take most of the time.
    for row in range(wanted.size):
        if not wanted[row]:
            continue
        s = int(row / interval_us)
        if s != current:
            current = s
            for j in range(3):
                _inverse_left_jacobian(omega[s + j], J)
                _multiply(J, R[s + j].T, before[j])
        segment[row] = s
        u = row / interval_us - s
        B[0] = (5.0 + u * (3.0 + u * (u - 3.0))) / 6.0
        B[1] = (1.0 + u * (3.0 + u * (3.0 - 2.0 * u))) / 6.0
        B[2] = u * u * u / 6.0
        for i in range(3):
            position = p[s, i]
            for j in range(3):
                position += B[j] * (p[s + j + 1, i] - p[s + j, i])
            table[row, 9 + i] = position
        table[row, 12], table[row, 13] = 1.0 - B[0], B[0] - B[1]
        table[row, 14], table[row, 15] = B[1] - B[2], B[2]
        for i in range(3):
            for k in range(3):
                S[i, k] = R[s, i, k]  # R_0 Exp(B_1 Omega_1) ... so far
                table[row, 16 + 3 * i + k] = 1.0 if i == k else 0.0
        for j in range(3):
            # M_j = S B_j J_l(B_j Omega_j) J_l^-1(Omega_j) R_(j-1)^T:
            # how a turn of control j relative to control j - 1 turns R(t), in the world.
            x, y, z = B[j] * omega[s + j, 0], B[j] * omega[s + j, 1], B[j] * omega[s + j, 2]
            a, b, c = _coefficients(x * x + y * y + z * z)
            _polynomial(x, y, z, B[j], B[j] * b, B[j] * c, J)
            _multiply(J, before[j], A)
            _multiply(S, A, M)
            for i in range(3):
                for k in range(3):
                    D = 16 + 9 * j + 3 * i + k
                    table[row, D] -= M[i, k]
                    table[row, D + 9] = M[i, k]
            _polynomial(x, y, z, 1.0, a, b, A)
            _multiply(S, A, next_S)
            S, next_S = next_S, S
        for i in range(3):
            for k in range(3):
                table[row, 3 * i + k] = S[i, k]
    return segment, table
