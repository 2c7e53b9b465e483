"""The same image from farther away: a plane that the camera faces, through a longer lens."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane

Float64 = NDArray[np.float64]


def farther(T_world_cam: Float64, plane: Plane, times: float) -> Float64:
    """Move a camera away from a plane, along the plane's normal.

    Parameters
    ----------
    T_world_cam
        (..., 4, 4) poses.
    plane
        The plane.
    times
        New distance over the old one.

    Returns
    -------
    (..., 4, 4) poses, with the same rotations.
    """
    moved = T_world_cam.copy()
    normal = np.asarray(plane.normal)
    distance_m = moved[..., :3, 3] @ normal - plane.offset_m
    moved[..., :3, 3] += (times - 1) * distance_m[..., None] * normal
    return moved


def longer_lens(camera: Camera, times: float) -> Camera:
    """Return a pinhole camera with longer focal lengths.

    Parameters
    ----------
    camera
        The camera.
    times
        New focal lengths over the old ones. From as many times the distance, a camera that faces a
        plane then sees the same of it at each pixel.

    Returns
    -------
    The camera, with the same size and principal point.
    """
    return Camera(
        camera.width,
        camera.height,
        fx=times * camera.fx,
        fy=times * camera.fy,
        cx=camera.cx,
        cy=camera.cy,
        distortion=camera.distortion,
    )
