"""What a camera of the rig sees of a page."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render import Camera
from tasks.rig.bundle import RigPose
from tasks.rig.calibration import on_page
from tasks.rig.page import PAPER, Page

Float64 = NDArray[np.float64]

_MAX_SUPERSAMPLES = 4


def page_views(
    camera: Camera, pose: RigPose, page: Page, light: Float64
) -> Callable[[float], Float64]:
    """Return a function from the slider's position, m, to the reflectance that the camera sees.

    It is averaged over the pixels, (H, W). Outside the page it is as white as paper.
    """
    shrunk: dict[int, NDArray[np.float32]] = {}  # the page in blocks of so many dots

    def view(x_m: float) -> Float64:
        corner = on_page(pose, camera, np.array([[0.0, 0.0], [1.0, 0.0]]), x_m)
        dots = float(np.linalg.norm(corner[1] - corner[0])) / page.dot_m  # across a pixel
        shrink = max(1, int(dots / 2))
        if shrink not in shrunk:
            shrunk[shrink] = _shrunk(light, shrink)
        times = min(_MAX_SUPERSAMPLES, max(1, math.ceil(dots / shrink)))
        steps = (np.arange(times) + 0.5) / times
        columns_px = (np.arange(camera.width)[:, None] + steps).ravel()
        rows_px = (np.arange(camera.height)[:, None] + steps).ravel()
        points_px = np.stack(np.meshgrid(columns_px, rows_px), axis=-1)
        # From meters to dots; the center of the first dot is (0, 0).
        at = on_page(pose, camera, points_px, x_m) / (shrink * page.dot_m) - 0.5
        x, y = np.moveaxis(at.astype(np.float32), -1, 0)
        image = cv2.remap(shrunk[shrink], x, y, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, PAPER)
        shape = camera.height, times, camera.width, times
        return np.asarray(image, np.float64).reshape(shape).mean(axis=(1, 3))

    return view


def _shrunk(light: Float64, times: int) -> NDArray[np.float32]:
    """Average blocks of `times` x `times` dots."""
    rows, columns = (size // times * times for size in light.shape)
    blocks = light[:rows, :columns].reshape(rows // times, times, columns // times, times)
    return blocks.mean(axis=(1, 3)).astype(np.float32)
