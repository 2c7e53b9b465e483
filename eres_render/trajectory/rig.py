"""A second camera on the rig of the first."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from eres_render.trajectory.spline import Trajectory

Float64 = NDArray[np.float64]

_STEP_S = 2e-3


def second_camera(
    path: Trajectory, T_cam_second: Float64, duration_s: float
) -> tuple[Float64, Float64]:
    """Return poses of a camera on the rig of another camera, for a spline through them.

    The poses are exact and at most 2 ms apart. Between them, `path_through` stays within
    micrometers of the rig at the speeds of a hand-held camera.

    Parameters
    ----------
    path
        Path of the first camera.
    T_cam_second
        (4, 4) pose of the second camera, along the first one's axes.
    duration_s
        Length of the path to use, s: the scene's duration, since a path may last longer.

    Returns
    -------
    t_s, T_world_second
        (N,) times on the path, s, and (N, 4, 4) poses.

    Raises
    ------
    TrajectoryError
        If the path is shorter than `duration_s`.
    """
    t_s = np.linspace(0.0, duration_s, max(2, math.ceil(duration_s / _STEP_S) + 1))
    return t_s, path.pose(t_s) @ T_cam_second


def to_the_right(baseline_m: float) -> Float64:
    """Return the pose (4, 4) of the right camera of a pair, along the left one's axes.

    Parameters
    ----------
    baseline_m
        Distance of the two, m.

    Returns
    -------
    T_left_right
        The right camera looks in the same direction.
    """
    T = np.eye(4)
    T[0, 3] = baseline_m
    return T
