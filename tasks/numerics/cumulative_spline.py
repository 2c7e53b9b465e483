"""The cumulative cubic B-spline at many times of a segment, with derivatives by its control poses.

The spline is that of `eres_render.Trajectory` with evenly spaced knots, split SO(3) x R^3 (Mueggler
et al., "Continuous-Time Visual-Inertial Odometry for Event Cameras", T-RO 2018, eq. 5):

    R(t) = R_0 Exp(B_1 Omega_1) Exp(B_2 Omega_2) Exp(B_3 Omega_3)
    p(t) = p_0 + B_1 (p_1 - p_0) + B_2 (p_2 - p_1) + B_3 (p_3 - p_2)

with Omega_j the rotation vector from control pose j - 1 to j, and control poses counted from the
first of the four that determine the pose at t. Rotations are perturbed on the left, in the world:
R <- Exp(delta) R. The derivatives are those of Sommer et al., "Efficient Derivative Computation for
Cumulative B-Splines on Lie Groups" (CVPR 2020), for that side.

Only vectors are turned, by v + a [w] v + b [w]^2 v, so that the loops over times, the last axis of
each array, are vectorized.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tasks.numerics.compiling import inlined, jit_contract_in_place
from tasks.numerics.vectors import Matrix, Vector, cross, mixed, rows_of, times, transposed_times


class Segment(NamedTuple):
    """What determines the poses between two knots, for j = 1, 2, 3; matrices are three rows."""

    p: Vector  # p_0
    steps: Matrix  # p_j - p_(j-1)
    turns: Matrix  # Omega_j
    R: Matrix  # R_0
    back: tuple[Matrix, Matrix, Matrix]  # R_(j-1) J_l^-T(Omega_j)


@jit_contract_in_place
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


@jit_contract_in_place
def _back(R, omega):
    """Return R J_l^-T(omega), where Exp(e) Exp(w) = Exp(w + J_l^-1(w) e)."""
    squared = omega[0] ** 2 + omega[1] ** 2 + omega[2] ** 2
    a, b, _ = _coefficients(squared)
    c = 1.0 / 12.0 + squared / 720.0 if squared < 1e-4 else (1.0 - 0.5 * a / b) / squared
    first, second, third = R
    return _back_row(first, omega, c), _back_row(second, omega, c), _back_row(third, omega, c)


@jit_contract_in_place
def _back_row(v, omega, c):
    """Return J_l^-1 v, a row v of R times J_l^-T."""
    once = cross(omega, v)
    return mixed(1.0, v, -0.5, once, c, cross(omega, once))


@jit_contract_in_place
def segment_after(R, p, omega, s):
    """Return the `Segment` whose first control pose is s.

    Parameters
    ----------
    R, p
        (M, 3, 3), (M, 3): rotations and positions of the control poses.
    omega
        (M - 1, 3): rotation vectors of `R[j].T @ R[j + 1]`.
    s
        0 to M - 4.
    """
    R_0, R_1, R_2 = rows_of(R[s]), rows_of(R[s + 1]), rows_of(R[s + 2])
    turns = rows_of(omega[s : s + 3])
    return Segment(
        (p[s, 0], p[s, 1], p[s, 2]),
        (_step(p, s), _step(p, s + 1), _step(p, s + 2)),
        turns,
        R_0,
        (_back(R_0, turns[0]), _back(R_1, turns[1]), _back(R_2, turns[2])),
    )


@jit_contract_in_place
def _step(p, s):
    return p[s + 1, 0] - p[s, 0], p[s + 1, 1] - p[s, 1], p[s + 1, 2] - p[s, 2]


@inlined
def weigh(n, u, segment, weights):
    """Compute the weights at n times of a segment, which `position`, `turn` and `pull_back` take.

    Parameters
    ----------
    u
        (N,), N >= n: the share of the segment before each time, 0 to 1.
    weights
        Written: (12, N), B_1 to B_3, then for each j the three of a turn by B_j Omega_j, as factors
        of [Omega_j] and its powers.
    """
    for k in range(n):
        s = u[k]
        weights[0, k] = (5.0 + s * (3.0 + s * (s - 3.0))) / 6.0
        weights[1, k] = (1.0 + s * (3.0 + s * (3.0 - 2.0 * s))) / 6.0
        weights[2, k] = s * s * s / 6.0
    for j in range(3):
        x, y, z = segment.turns[j]
        squared = x * x + y * y + z * z
        for k in range(n):
            B = weights[j, k]
            a, b, c = _coefficients(B * B * squared)
            weights[3 + 3 * j, k] = a * B
            weights[4 + 3 * j, k] = b * B * B
            weights[5 + 3 * j, k] = c * B * B * B


@inlined
def position(weights, k, segment):
    """Return p(t) at the k-th time, a tuple of 3."""
    x, y, z = mixed(
        weights[0, k],
        segment.steps[0],
        weights[1, k],
        segment.steps[1],
        weights[2, k],
        segment.steps[2],
    )
    return segment.p[0] + x, segment.p[1] + y, segment.p[2] + z


@inlined
def turn(n, weights, segment, v):
    """Multiply a vector at each of n times by R(t), in place; `v` is (3, N)."""
    for j in range(2, -1, -1):
        omega = segment.turns[j]
        for k in range(n):
            u = v[0, k], v[1, k], v[2, k]
            once = cross(omega, u)
            twice = cross(omega, once)
            v[0, k], v[1, k], v[2, k] = mixed(
                1.0, u, weights[3 + 3 * j, k], once, weights[4 + 3 * j, k], twice
            )
    for k in range(n):
        v[0, k], v[1, k], v[2, k] = times(segment.R, (v[0, k], v[1, k], v[2, k]))


@inlined
def pull_back(n, weights, segment, q, w, J):
    """Compute derivatives in the four control poses from those in the pose, at n times.

    Parameters
    ----------
    q
        (3, N): d/dp(t).
    w
        (3, N): d/ddelta for R(t) <- Exp(delta) R(t); overwritten.
    J
        Written: (24, N), for each control pose d/dp_c, then d/ddelta_c.
    """
    for k in range(n):
        B_1, B_2, B_3 = weights[0, k], weights[1, k], weights[2, k]
        x, y, z = q[0, k], q[1, k], q[2, k]
        J[0, k], J[1, k], J[2, k] = (1.0 - B_1) * x, (1.0 - B_1) * y, (1.0 - B_1) * z
        J[6, k], J[7, k], J[8, k] = (B_1 - B_2) * x, (B_1 - B_2) * y, (B_1 - B_2) * z
        J[12, k], J[13, k], J[14, k] = (B_2 - B_3) * x, (B_2 - B_3) * y, (B_2 - B_3) * z
        J[18, k], J[19, k], J[20, k] = B_3 * x, B_3 * y, B_3 * z
        v = w[0, k], w[1, k], w[2, k]
        J[3, k], J[4, k], J[5, k] = v
        w[0, k], w[1, k], w[2, k] = transposed_times(segment.R, v)
    # A turn of control pose j relative to j - 1 turns R(t), in the world, by
    # S B_j J_l(B_j Omega_j) J_l^-1(Omega_j) R_(j-1)^T, with S = R_0 Exp(B_1 Omega_1) ... so far.
    for j in range(3):
        omega, back = segment.turns[j], segment.back[j]
        for k in range(n):
            v = w[0, k], w[1, k], w[2, k]  # S^T d/ddelta
            once = cross(omega, v)
            twice = cross(omega, once)
            a, b, c = weights[3 + 3 * j, k], weights[4 + 3 * j, k], weights[5 + 3 * j, k]
            x, y, z = times(back, mixed(weights[j, k], v, -b, once, c, twice))
            J[6 * j + 3, k] -= x
            J[6 * j + 4, k] -= y
            J[6 * j + 5, k] -= z
            J[6 * j + 9, k], J[6 * j + 10, k], J[6 * j + 11, k] = x, y, z
            w[0, k], w[1, k], w[2, k] = mixed(1.0, v, -a, once, b, twice)
