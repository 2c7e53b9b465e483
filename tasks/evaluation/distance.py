"""Poses farther away from a plane, from which `Camera.zoomed` shows the same image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eres_render import Plane

Float64 = NDArray[np.float64]


def farther(T_world_cam: Float64, plane: Plane, times: float) -> Float64:
    """Move a camera away from a plane, along the plane's normal.

    Parameters
    ----------
    T_world_cam
        (..., 4, 4) poses.

    Returns
    -------
    (..., 4, 4) poses, with the same rotations.
    """
    moved = T_world_cam.copy()
    normal = np.asarray(plane.normal)
    distance_m = moved[..., :3, 3] @ normal - plane.offset_m
    moved[..., :3, 3] += (times - 1) * distance_m[..., None] * normal
    return moved
