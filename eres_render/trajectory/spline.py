"""The camera's path: a cumulative cubic B-spline, from control poses or through given poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_banded
from scipy.spatial.transform import Rotation

from eres_render.errors import TrajectoryError

Float64 = NDArray[np.float64]

_TURN_TOLERANCE_RAD = 1e-12
_MIN_DAMPING = 1e-3
_STRETCHES_AT_ONCE = 1 << 14  # whose lengths are computed together, with 8 poses each


class TurnsTooFarError(TrajectoryError):
    """The camera turns too far between two poses; the spline misses pose `number` by the most."""

    number: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory:
    """A twice continuously differentiable path of poses.

    Rotation and position have separate splines (SO(3) x R^3). So scaling the positions scales the
    speed by exactly that factor, and the path of the camera center does not depend on rotations.
    Methods raise `TrajectoryError` for times off the path.

    Parameters
    ----------
    knots_s
        (N,) strictly increasing times of the control poses, N >= 4. The path starts at the second
        time, which must be 0, and ends at the second to last.
    controls
        (N, 4, 4) control poses T_world_cam; the path runs near them, not through them. For a path
        through given poses see `path_through`.
    t_offset_us
        Time 0 of the path on the clock of its poses, microseconds. It is separate because seconds
        since 1970 in float64 are 0.2 us apart.

    Raises
    ------
    TrajectoryError
        If there are fewer than four control poses, a matrix is not a rotation, or the times are not
        finite, do not increase, or are not 0 at the second pose. Positions may be NaN, as where a
        method fails.

    Examples
    --------
    Five control poses a tenth of a second apart; the path starts at the second:

    >>> import numpy as np
    >>> from eres_render import Trajectory
    >>> controls = np.tile(np.eye(4), (5, 1, 1))
    >>> controls[:, 0, 3] = [-0.1, 0.0, 0.1, 0.2, 0.3]  # 1 m/s to the right
    >>> path = Trajectory(0.1 * np.arange(-1.0, 4.0), controls)
    >>> path
    Trajectory(5 control poses, 0.2 s)
    >>> round(path.duration_s, 6), round(path.mean_speed_mps(0.2), 6)
    (0.2, 1.0)
    >>> path.pose(0.05)[:3, 3].round(6)
    array([0.05, 0.  , 0.  ])
    >>> path.velocity(0.05).round(6)
    array([1., 0., 0.])
    """

    knots_s: Float64
    controls: Float64
    t_offset_us: int = 0

    def __post_init__(self) -> None:
        for name in ("knots_s", "controls"):
            own = np.array(getattr(self, name), dtype=np.float64)  # what follows from them is kept
            own.flags.writeable = False
            object.__setattr__(self, name, own)
        object.__setattr__(self, "t_offset_us", int(self.t_offset_us))
        shape = self.controls.shape
        if len(shape) != 3 or shape[0] < 4 or shape[1:] != (4, 4):
            raise TrajectoryError(
                f"Trajectory.controls: found shape {shape}, expected (N, 4, 4) with N of at least 4"
            )
        knots = self.knots_s
        check_finite("Trajectory.knots_s", knots)
        if knots.shape != shape[:1] or not np.all(np.diff(knots) > 0) or knots[1] != 0:
            raise TrajectoryError(
                f"Trajectory.knots_s: found shape {knots.shape}, {knots[:3].tolist()}..., expected "
                f"{shape[0]} increasing times, of which the second is 0"
            )
        _check_rotations("Trajectory.controls", self.controls)

    def __getstate__(self) -> dict[str, Any]:
        """Return what copies have: not what follows from the poses, which may be changed there."""
        computed = "_extended_s", "_steps"
        return {name: value for name, value in vars(self).items() if name not in computed}

    @cached_property
    def _extended_s(self) -> Float64:
        return _evenly_extended(self.knots_s)

    def __repr__(self) -> str:
        return f"Trajectory({len(self.controls)} control poses, {self.duration_s:g} s)"

    @property
    def duration_s(self) -> float:
        """How long the path lasts."""
        return float(self.knots_s[-2])

    def pose(self, t_s: ArrayLike) -> Float64:
        """Return T_world_cam, (..., 4, 4), at the times (...) in seconds.

        Raises
        ------
        TrajectoryError
            If a time lies outside [0, duration_s].
        """
        i, weights, _, _ = self._weights(t_s)
        _, turn_steps = self._steps
        T = np.zeros((*i.shape, 4, 4))
        T[..., 3, 3] = 1.0
        R = self.controls[i, :3, :3]
        rotvecs = weights[..., None] * turn_steps[i[..., None] + np.arange(3)]
        turns = Rotation.from_rotvec(rotvecs.reshape(-1, 3)).as_matrix()
        turns = turns.reshape(*i.shape, 3, 3, 3)
        for j in range(3):
            R = R @ turns[..., j, :, :]
        T[..., :3, :3], T[..., :3, 3] = R, self._moved(i, weights, self.controls[i, :3, 3])
        return T

    def position(self, t_s: ArrayLike) -> Float64:
        """Return the camera center in the world, (..., 3) m: that of `pose`, many times faster."""
        i, weights, _, _ = self._weights(t_s)
        return self._moved(i, weights, self.controls[i, :3, 3])

    def velocity(self, t_s: ArrayLike) -> Float64:
        """Return the velocity of the camera center in the world, (..., 3) m/s."""
        i, _, rates, _ = self._weights(t_s)
        return self._moved(i, rates, np.zeros((*i.shape, 3)))

    def acceleration(self, t_s: ArrayLike) -> Float64:
        """Return the acceleration of the camera center in the world, (..., 3) m/s^2."""
        i, _, _, bends = self._weights(t_s)
        return self._moved(i, bends, np.zeros((*i.shape, 3)))

    def _moved(self, i: NDArray[np.intp], weights: Float64, start: Float64) -> Float64:
        """Return the sum of a start and the weighted three steps in position from control i on."""
        steps, _ = self._steps
        return sum((weights[..., j, None] * steps[i + j] for j in range(3)), start)

    def angular_velocity(self, t_s: ArrayLike) -> Float64:
        """Return the angular velocity of the camera along its own axes, (..., 3) rad/s.

        Step by step through the product of rotations, as in Sommer et al. 2020, "Efficient
        derivative computation for cumulative B-splines on Lie groups".
        """
        i, weights, rates, _ = self._weights(t_s)
        _, steps = self._steps
        omega = np.zeros((*i.shape, 3))
        for j in range(3):
            rotvec = (weights[..., j, None] * steps[i + j]).reshape(-1, 3)
            back = Rotation.from_rotvec(-rotvec).as_matrix().reshape(*i.shape, 3, 3)
            omega = (back @ omega[..., None])[..., 0] + rates[..., j, None] * steps[i + j]
        return omega

    def length_m(self, t_s: ArrayLike) -> Float64:
        """Return the length of the path from 0 to each of the times (...), by quadrature."""
        t = np.asarray(t_s, dtype=np.float64)
        knots = np.clip(self.knots_s, 0.0, float(t.max()))
        sixteenths = (np.arange(16) / 16)[:, None]
        inner = (knots[:-1] + sixteenths * np.diff(knots)).ravel()
        edges = np.unique(np.concatenate([inner, t.ravel(), [0.0]]))
        nodes, weights = np.polynomial.legendre.leggauss(8)
        half = 0.5 * np.diff(edges)
        each = np.empty_like(half)
        for k in range(0, len(half), _STRETCHES_AT_ONCE):  # paths may have a million poses
            of = slice(k, k + _STRETCHES_AT_ONCE)
            at_s = edges[:-1][of, None] + half[of, None] * (nodes + 1)
            each[of] = (np.linalg.norm(self.velocity(at_s), axis=-1) * weights).sum(axis=-1)
        length = np.concatenate([[0.0], np.cumsum(half * each)])
        return length[np.searchsorted(edges, t)]

    def mean_speed_mps(self, duration_s: float) -> float:
        """Return path length over time in [0, duration_s]."""
        return float(self.length_m(duration_s)) / duration_s

    @cached_property
    def _steps(self) -> tuple[Float64, Float64]:
        """From each control pose to the next: (N - 1, 3) meters, (N - 1, 3) rotation vectors."""
        turn = Rotation.from_matrix(self.controls[:, :3, :3])
        return np.diff(self.controls[:, :3, 3], axis=0), (turn[:-1].inv() * turn[1:]).as_rotvec()

    def _weights(self, t_s: ArrayLike) -> tuple[NDArray[np.intp], Float64, Float64, Float64]:
        """Return the first of each time's four controls, and the weights of the steps from it.

        The weights (..., 3) are a cumulative basis: the finished share of the step from control i +
        j to the next. Their first and second time derivatives, 1/s and 1/s^2, follow.
        """
        t = np.asarray(t_s, dtype=np.float64)
        tolerance_s = 1e-9
        if not np.all((t >= -tolerance_s) & (t <= self.duration_s + tolerance_s)):
            raise TrajectoryError(
                f"the path covers 0 to {self.duration_s:g} s; the requested times are "
                f"{t.min():g} to {t.max():g} s"
            )
        i = np.clip(np.searchsorted(self.knots_s, t, side="right") - 2, 0, len(self.knots_s) - 4)
        return i, *_cumulative_basis(self._extended_s, i, t)


def check_finite(name: str, values: Float64) -> None:
    """Refuse numbers, (N, ...), that are not finite."""
    finite = np.isfinite(values)
    if not finite.all():
        k = int(np.argwhere(~finite)[0, 0])
        raise TrajectoryError(
            f"{name}: found {values[k].tolist()} at index {k}, expected finite numbers"
        )


def _check_rotations(name: str, T: Float64) -> None:
    R = T[:, :3, :3]
    with np.errstate(all="ignore"):  # large numbers overflow
        error = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2))
        is_rotation = (error < 1e-5) & (np.linalg.det(R) > 0)
    if not is_rotation.all():
        k = int(np.argmin(is_rotation))
        raise TrajectoryError(
            f"{name}: found {R[k].tolist()} at index {k}, expected a rotation: orthonormal, with "
            "determinant 1"
        )


def path_through(t_s: ArrayLike, T_world_cam: Float64, t_offset_us: int = 0) -> Trajectory:
    """Return the spline that passes through given poses at given times.

    It has a knot at each time and no acceleration at either end (a natural spline).
    Between the poses it is as smooth as `Trajectory`: position, rotation and both their first
    derivatives are continuous.

    Parameters
    ----------
    t_s
        (N,) strictly increasing times, N >= 2. The path starts at the first, its time 0.
    T_world_cam
        (N, 4, 4) poses.
    t_offset_us
        Offset of the path's clock; see `Trajectory`.

    Returns
    -------
    trajectory
        The path.

    Raises
    ------
    TrajectoryError
        If there are fewer than two poses, a matrix is not a pose, times do not increase, or the
        camera turns so far between two poses that no spline is found.

    Examples
    --------
    >>> import numpy as np
    >>> from eres_render import path_through
    >>> poses = np.tile(np.eye(4), (3, 1, 1))
    >>> poses[:, 0, 3] = [0.1, 0.3, 0.3]
    >>> path = path_through([0.0, 0.5, 1.0], poses)
    >>> path.pose([0.0, 0.5, 1.0])[:, 0, 3].round(6)
    array([0.1, 0.3, 0.3])
    >>> round(float(path.velocity(0.5)[0]), 3)  # m/s
    0.2
    """
    t, T_world_cam = _checked_poses(t_s, T_world_cam)
    knots, n = _evenly_extended(t - t[0]), len(t)
    banded, first_step, last_step = _natural_system(_evenly_extended(knots))
    position = solve_banded((1, 1), banded, T_world_cam[:, :3, 3])
    before = position[0] - first_step * (position[1] - position[0])
    after = position[-1] + last_step * (position[-1] - position[-2])
    position = np.concatenate([[before], position, [after]])
    # Rotations do not commute, so damped Newton iterations find their controls, with the same
    # matrix, which is the exact derivative for a camera that does not turn.
    wanted = Rotation.from_matrix(T_world_cam[:, :3, :3])

    def path_of(inner: Rotation) -> tuple[Trajectory, Float64]:
        """Return the path with these inner controls, and its (N, 3) rotation errors."""
        steps = (inner[:-1].inv() * inner[1:]).as_rotvec()
        first = inner[0] * Rotation.from_rotvec(-first_step * steps[0])
        last = inner[-1] * Rotation.from_rotvec(last_step * steps[-1])
        controls = np.tile(np.eye(4), (n + 2, 1, 1))
        controls[:, :3, :3] = Rotation.concatenate([first, inner, last]).as_matrix()
        controls[:, :3, 3] = position
        path = Trajectory(knots, controls, t_offset_us)
        reached = Rotation.from_matrix(path.pose(knots[1:-1])[:, :3, :3])
        return path, (reached.inv() * wanted).as_rotvec()

    inner, damping = wanted, 1.0
    path, missed = path_of(inner)
    while abs(missed).max() > _TURN_TOLERANCE_RAD:
        candidate = inner * Rotation.from_rotvec(damping * solve_banded((1, 1), banded, missed))
        path, missed_now = path_of(candidate)
        if abs(missed_now).max() < abs(missed).max():
            inner, missed, damping = candidate, missed_now, min(1.0, 2 * damping)
        else:
            damping /= 2
        if damping < _MIN_DAMPING:
            worst = int(np.argmax(np.linalg.norm(missed, axis=1)))
            error = TurnsTooFarError(
                "path_through: the camera turns too far from pose to pose near t = "
                f"{t[worst]:g} s{' after the first' if t_offset_us else ''}; give more poses there"
            )
            error.number = worst
            raise error
    return path


def _checked_poses(t_s: ArrayLike, T_world_cam: ArrayLike) -> tuple[Float64, Float64]:
    """Return (N,) times and (N, 4, 4) poses as float64, after the checks of `path_through`."""
    t, T_world_cam = np.asarray(t_s, dtype=np.float64), np.asarray(T_world_cam, dtype=np.float64)
    if t.ndim != 1 or T_world_cam.shape != (len(t), 4, 4) or len(t) < 2:
        raise TrajectoryError(
            f"found {t.size} times and poses of shape {T_world_cam.shape}, expected at least two "
            "poses (N, 4, 4), each with a time"
        )
    if not np.all(np.isfinite(t)) or not np.all(np.diff(t) > 0):
        k = int(np.argmin(np.diff(t) > 0))
        raise TrajectoryError(f"found {t[k + 1]:g} s after {t[k]:g} s, expected increasing times")
    check_finite("poses", T_world_cam)
    _check_rotations("poses", T_world_cam)
    return t, T_world_cam


def _natural_system(extended: Float64) -> tuple[Float64, float, float]:
    """Return the equations for the control positions of a path through given positions.

    From the N knots, with two more on each side, come a (3, N) matrix for `solve_banded`, and how
    many times as long as its neighbor the first and the last step between controls is.
    """
    n = len(extended) - 4
    # Position k is a_k c_(k-1) + b_k c_k + d_k c_(k+1), in control positions c.
    k0, k1, k2, k3, k4 = (extended[j : j + n] for j in range(5))
    a = (k3 - k2) ** 2 / ((k3 - k0) * (k3 - k1))
    d = (k2 - k1) ** 2 / ((k4 - k1) * (k3 - k1))
    b = 1 - a - d
    # No acceleration at the ends: the outermost two steps have equal velocity.
    span = extended[3:] - extended[:-3]  # the duration of each step
    first_step, last_step = span[0] / span[1], span[-1] / span[-2]
    banded = np.zeros((3, n))
    banded[0, 1:], banded[1], banded[2, :-1] = d[:-1], b, a[1:]
    banded[1, 0] += a[0] * (1 + first_step)
    banded[0, 1] -= a[0] * first_step
    banded[1, -1] += d[-1] * (1 + last_step)
    banded[2, -2] -= d[-1] * last_step
    return banded, first_step, last_step


def _evenly_extended(knots_s: Float64) -> Float64:
    """Return (N,) times with one more on each side, at the distance of the outermost two."""
    return np.concatenate([[2 * knots_s[0] - knots_s[1]], knots_s, [2 * knots_s[-1] - knots_s[-2]]])


def _cumulative_basis(
    extended_s: Float64, i: NDArray[np.intp], t: Float64
) -> tuple[Float64, Float64, Float64]:
    """Return the cumulative cubic basis and two time derivatives at t in the i-th segment.

    De Boor's recursion, written out for [k2, k3]; `extended_s` has one more time on each side.
    """
    k0, k1, k2, k3, k4, k5 = (extended_s[i + j] for j in range(6))
    linear = np.stack([k3 - t, t - k2]) / (k3 - k2)
    q1 = (k3 - t) / (k3 - k1) * linear[0]
    q2 = (t - k1) / (k3 - k1) * linear[0] + (k4 - t) / (k4 - k2) * linear[1]
    q3 = (t - k2) / (k4 - k2) * linear[1]
    first = (k3 - t) / (k3 - k0) * q1
    third = (t - k1) / (k4 - k1) * q2 + (k5 - t) / (k5 - k2) * q3
    fourth = (t - k2) / (k5 - k2) * q3
    weights = np.stack([1 - first, third + fourth, fourth], axis=-1)
    spans = np.stack([k3 - k0, k4 - k1, k5 - k2], axis=-1)
    rates = 3 * np.stack([q1, q2, q3], axis=-1) / spans
    falls, rises = linear[0] / (k3 - k1), linear[1] / (k4 - k2)
    bends = 6 * np.stack([-falls, falls - rises, rises], axis=-1) / spans
    return weights, rates, bends
