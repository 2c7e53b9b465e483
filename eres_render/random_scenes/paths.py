"""Random paths of a camera and of objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eres_render.trajectory.generators import look_at, random_path

Float64 = NDArray[np.float64]

STEP_S = 0.025
"""Time between the poses of a path; a spline passes through them."""

_SWAY = (1.0, 0.6, 0.6)  # of the camera: right, down, ahead; only the ratios matter
_LOG_SPEED_MPS = np.log([0.1, 1.0])
_LOG_TURN_RAD_S = np.log([0.1, 1.0])
_FARTHEST_M = 1.0  # from the middle of its path
_KNOT_S = (0.25, 0.6)
_REACH_M = (0.05, 0.5)  # of an object along each axis
_LOG_OBJECT_SPEED_MPS = np.log([0.1, 1.5])
_LOG_SPIN_RAD_S = np.log([0.1, 3.0])


@dataclass(frozen=True, eq=False, slots=True)
class Poses:
    """A path: (N,) times in seconds and (N, 4, 4) poses, for a spline through them."""

    t_s: Float64
    T_world: Float64


def path_times(duration_s: float) -> Float64:
    """Return the times from 0 to the end of a path, (N,) s, at most `STEP_S` apart."""
    return np.linspace(0.0, duration_s, int(np.ceil(duration_s / STEP_S)) + 1)


def camera_path(duration_s: float, rng: np.random.Generator) -> Poses:
    """Return a random path within 1 m of the origin that looks roughly along y; z is up."""
    turn, pitch = rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2)
    home = look_at((0, 0, 0), (np.sin(turn), np.cos(turn), np.sin(pitch)), (0, 0, 1))
    knot_s = float(rng.uniform(*_KNOT_S))
    turn_rad = knot_s * float(np.exp(rng.uniform(*_LOG_TURN_RAD_S)))
    path = random_path(
        home,
        duration_s=duration_s,
        mean_speed_mps=float(np.exp(rng.uniform(*_LOG_SPEED_MPS))),
        knot_interval_s=knot_s,
        sway=_SWAY,
        turn_rad=(turn_rad, turn_rad, turn_rad),
        seed=int(rng.integers(1 << 32)),
    )
    t_s = path_times(duration_s)
    T = path.pose(t_s)
    place_m = T[:, :3, 3] - T[:, :3, 3].mean(axis=0)
    T[:, :3, 3] = place_m * min(1.0, _FARTHEST_M / np.linalg.norm(place_m, axis=1).max())
    return Poses(t_s, T)


def object_path(center_m: Float64, duration_s: float, rng: np.random.Generator) -> Poses:
    """Return a random path of an object: it swings about a place, (3,) m, and spins evenly.

    Along each axis it is a sine of its own reach and frequency (a Lissajous figure), so the object
    stays near the place however long the path lasts.
    """
    t_s = path_times(duration_s)
    reach_m = rng.uniform(*_REACH_M, 3)
    direction = rng.normal(size=3)
    speed_mps = np.exp(rng.uniform(*_LOG_OBJECT_SPEED_MPS)) * direction / np.linalg.norm(direction)
    phase = rng.uniform(0, 2 * np.pi, 3)
    T = np.tile(np.eye(4), (len(t_s), 1, 1))
    T[:, :3, 3] = center_m + reach_m * np.sin(np.outer(t_s, speed_mps / reach_m) + phase)
    axis = rng.normal(size=3)
    spin = np.exp(rng.uniform(*_LOG_SPIN_RAD_S)) * axis / np.linalg.norm(axis)
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(t_s, spin)).as_matrix()
    return Poses(t_s, T)
