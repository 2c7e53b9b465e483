"""Camera paths: random ones that face a plane, and loops through waypoints."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from eres_render.camera import Plane
from eres_render.errors import TrajectoryError, check_positive
from eres_render.trajectory.spline import Trajectory, TurnsTooFarError, path_through

Float64 = NDArray[np.float64]

_MAX_SEGMENTS = 100_000  # of a path: hours at usual speeds


def facing_plane(plane: Plane, target: ArrayLike, distance_m: float) -> Float64:
    """Return the pose, (4, 4), that looks straight at a point on a plane, from its front, upright.

    Up in the image is the world's y axis (the z axis for a plane that faces along y).
    """
    z = -np.asarray(plane.normal)
    up = np.array([0.0, 1.0, 0.0]) if abs(z[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    target = np.asarray(target)
    return look_at(target - distance_m * z, target - (distance_m - 1) * z, up)


def look_at(position_m: ArrayLike, target_m: ArrayLike, up: ArrayLike) -> Float64:
    """Return the pose, (4, 4), at a position, (3,) m, that looks at a target with `up` upward."""
    z = np.asarray(target_m, dtype=np.float64) - np.asarray(position_m)
    x = np.cross(z, np.asarray(up))
    if not np.linalg.norm(x) > 1e-6 * np.linalg.norm(z) * np.linalg.norm(up):
        raise TrajectoryError(
            f"target_m: found {np.asarray(target_m).tolist()}, expected a point away from the "
            f"camera, {np.asarray(position_m).tolist()}, and not straight above or below it"
        )
    z, x = z / np.linalg.norm(z), x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    T[:3, 3] = position_m
    return T


def random_path(
    home: Float64,
    *,
    duration_s: float,
    mean_speed_mps: float,
    knot_interval_s: float,
    sway: tuple[float, float, float],
    turn_rad: tuple[float, float, float],
    seed: int,
) -> Trajectory:
    """Return a seeded random 6-DoF path around a pose, with an exact mean speed.

    Each control pose is drawn independently: an offset in the box +-`sway` along the home camera's
    axes, and a rotation vector in the box +-`turn_rad`. All offsets are then scaled so that the
    mean speed over [0, duration_s] is `mean_speed_mps`: only the ratios of `sway` matter, and the
    distance from home grows with speed and knot interval.

    Parameters
    ----------
    home
        (4, 4) T_world_cam in the middle of the path.
    duration_s, knot_interval_s
        The path has ceil(duration_s / knot_interval_s) segments and may outlast `duration_s`.
    mean_speed_mps
        Mean speed over [0, duration_s], exact.
    sway
        Relative reach along the home camera's x, y and z axis.
    turn_rad
        Largest rotation about the home camera's x (tilt), y (pan) and z axis (roll).
    seed
        Seed of all control poses.

    Returns
    -------
    trajectory
        The path.

    Raises
    ------
    TrajectoryError
        If a duration or the speed is not positive, the path has more than 100,000 segments, or
        `sway` is 0 along all axes.

    Examples
    --------
    >>> import numpy as np
    >>> from eres_render import random_path
    >>> path = random_path(
    ...     np.eye(4),
    ...     duration_s=2.0,
    ...     mean_speed_mps=0.8,
    ...     knot_interval_s=0.5,
    ...     sway=(1.0, 1.0, 0.2),
    ...     turn_rad=(0.1, 0.1, 0.1),
    ...     seed=0,
    ... )
    >>> round(path.mean_speed_mps(2.0), 6)
    0.8
    """
    numbers = {"duration_s": duration_s, "mean_speed_mps": mean_speed_mps}
    for name, value in (numbers | {"knot_interval_s": knot_interval_s}).items():
        check_positive(name, value, TrajectoryError)
    if not duration_s / knot_interval_s <= _MAX_SEGMENTS:
        raise TrajectoryError(
            f"knot_interval_s: found {knot_interval_s:g} s in a path of {duration_s:g} s, expected "
            f"at least {1.01 * duration_s / _MAX_SEGMENTS:.3g} s (limit: {_MAX_SEGMENTS} segments)"
        )
    rng = np.random.default_rng(seed)
    n = int(np.ceil(duration_s / knot_interval_s - 1e-9)) + 3
    offsets = rng.uniform(-1.0, 1.0, (n, 3)) * sway
    turns = rng.uniform(-1.0, 1.0, (n, 3)) * turn_rad
    controls = np.tile(home, (n, 1, 1))
    controls[:, :3, :3] = home[:3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    controls[:, :3, 3] = home[:3, 3] + offsets @ home[:3, :3].T
    knots_s = knot_interval_s * np.arange(-1.0, n - 1)
    unscaled_mps = Trajectory(knots_s, controls).mean_speed_mps(duration_s)
    if not unscaled_mps > 0:
        raise TrajectoryError(f"sway: found {sway}, expected a vector that moves the camera")
    scale = mean_speed_mps / unscaled_mps
    controls[:, :3, 3] = home[:3, 3] + scale * (controls[:, :3, 3] - home[:3, 3])
    return Trajectory(knots_s, controls)


def waypoint_loop(
    waypoints: Float64,
    *,
    duration_s: float,
    mean_speed_mps: float,
    sway_m: tuple[float, float, float],
    turn_rad: tuple[float, float, float],
    seed: int,
) -> Trajectory:
    """Return a path of rounds through waypoints, with an exact mean speed.

    Each time the camera passes a waypoint, a new pose is drawn: an offset in the box +-`sway_m` and
    a rotation vector in the box +-`turn_rad` along the waypoint's axes. So no two rounds are the
    same. A spline goes through these poses (`path_through`). The time between its knots is
    proportional to the distance between the poses, which keeps the speed even. The path ends after
    `duration_s`, in the first round or later.

    Parameters
    ----------
    waypoints
        (N, 4, 4) poses T_world_cam, N >= 2.
    duration_s
        How long the path lasts.
    mean_speed_mps
        Mean speed, exact.
    sway_m
        Largest offset from a waypoint along its x, y and z axis.
    turn_rad
        Largest rotation about a waypoint's x, y and z axis.
    seed
        Seed of all offsets.

    Returns
    -------
    trajectory
        The path.

    Raises
    ------
    TrajectoryError
        If there are fewer than two waypoints, the duration or the speed is not positive, the path
        passes more than 100,000 waypoints, consecutive poses coincide, or the camera turns too far
        between two poses.

    Examples
    --------
    Between two places a meter apart:

    >>> import numpy as np
    >>> from eres_render import waypoint_loop
    >>> places = np.tile(np.eye(4), (2, 1, 1))
    >>> places[1, 0, 3] = 1.0
    >>> path = waypoint_loop(
    ...     places,
    ...     duration_s=5.0,
    ...     mean_speed_mps=0.5,
    ...     sway_m=(0.0, 0.0, 0.0),
    ...     turn_rad=(0.0, 0.0, 0.0),
    ...     seed=0,
    ... )
    >>> round(path.mean_speed_mps(5.0), 6)
    0.5
    """
    check_positive("duration_s", duration_s, TrajectoryError)
    check_positive("mean_speed_mps", mean_speed_mps, TrajectoryError)
    if len(waypoints) < 2:
        raise TrajectoryError(f"waypoints: found {len(waypoints)}, expected two or more")
    rng = np.random.default_rng(seed)
    length_m = duration_s * mean_speed_mps
    poses: list[Float64] = []
    chord_m = [0.0]
    # One pose more than the chords need: the spline is never shorter than its chords, and its end
    # must not bend the part that is used.
    while len(poses) < 3 or chord_m[-2] < length_m:
        if len(poses) > _MAX_SEGMENTS:
            raise TrajectoryError(
                f"duration_s: found {duration_s:g} s at {mean_speed_mps:g} m/s, expected at most "
                f"{duration_s * chord_m[-1] / length_m:.3g} s (limit: {_MAX_SEGMENTS} waypoints)"
            )
        T = waypoints[len(poses) % len(waypoints)].copy()
        offset, turn = rng.uniform(-1.0, 1.0, (2, 3))
        T[:3, 3] += T[:3, :3] @ (offset * sway_m)
        T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(turn * turn_rad).as_matrix()
        if poses:
            chord_m.append(chord_m[-1] + float(np.linalg.norm(T[:3, 3] - poses[-1][:3, 3])))
            if not chord_m[-1] > chord_m[-2]:
                raise TrajectoryError(
                    f"waypoints[{len(poses) % len(waypoints)}]: has the same position as the "
                    f"previous waypoint, {T[:3, 3].tolist()}"
                )
        poses.append(T)
    try:
        path = path_through(chord_m, np.array(poses))
    except TurnsTooFarError as error:
        raise TrajectoryError(
            f"waypoints[{error.number % len(waypoints)}]: the camera turns too far to or from it; "
            "give more waypoints there"
        ) from error
    end = brentq(lambda t: float(path.length_m(t)) - length_m, 0.0, path.duration_s, xtol=1e-12)
    return Trajectory(path.knots_s * (duration_s / end), path.controls)
