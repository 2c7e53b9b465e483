"""The pinhole rays that a lens bends to positions in the image, on arrays of Dr.Jit."""

from __future__ import annotations

from typing import Any

from eres_render.camera import Camera
from eres_render.distortion import Distortion, polynomials

_STEPS = 3  # of Newton's method from the pixel's center: 1e-12 of the image plane at distance 1


def undistorted(camera: Camera, lens: Distortion, position: Any) -> Any:
    """Return `Camera.undistort` of N points (mi.Point2f, px), exact to single precision."""
    import drjit as dr
    import mitsuba as mi

    centers = (camera.undistorted_positions() - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    column = dr.minimum(mi.UInt32(position.x), camera.width - 1)
    row = dr.minimum(mi.UInt32(position.y), camera.height - 1)
    start = dr.gather(mi.Point2d, mi.Float64(centers.ravel()), row * camera.width + column)
    x, y = start.x, start.y
    wanted_x = (mi.Float64(position.x) - camera.cx) / camera.fx
    wanted_y = (mi.Float64(position.y) - camera.cy) / camera.fy
    for _ in range(_STEPS):
        image_x, image_y, xx, xy, yy = polynomials(x, y, lens)
        off_x, off_y = wanted_x - image_x, wanted_y - image_y
        determinant = xx * yy - xy * xy
        step_x = (off_x * yy - off_y * xy) / determinant
        step_y = (off_y * xx - off_x * xy) / determinant
        x, y = x + step_x, y + step_y
    return mi.Point2f(mi.Float(x * camera.fx + camera.cx), mi.Float(y * camera.fy + camera.cy))
