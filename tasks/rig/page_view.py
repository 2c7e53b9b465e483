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


def page_view(
    crop_camera: Camera, pose: RigPose, x_m: float, page: Page, light: Float64
) -> Float64:
    """Return the reflectance that a camera sees, averaged over its pixels.

    Parameters
    ----------
    x_m
        Position of the slider, m.
    light
        (H, W) its reflectance.

    Returns
    -------
    view
        (h, w). Outside the page it is as white as paper.
    """
    return page_views(crop_camera, pose, page, light)(x_m)


def page_views(
    crop_camera: Camera, pose: RigPose, page: Page, light: Float64
) -> Callable[[float], Float64]:
    """Return a function of the slider's position, m, that returns what the camera sees there."""
    shrunk: dict[int, NDArray[np.float32]] = {}  # the page in blocks of so many dots

    def view(x_m: float) -> Float64:
        corner = on_page(pose, crop_camera, np.array([[0.0, 0.0], [1.0, 0.0]]), x_m)
        dots = float(np.linalg.norm(corner[1] - corner[0])) / page.dot_m  # across a pixel
        shrink = max(1, int(dots / 2))
        if shrink not in shrunk:
            shrunk[shrink] = _shrunk(light, shrink)
        times = min(_MAX_SUPERSAMPLES, max(1, math.ceil(dots / shrink)))
        steps = (np.arange(times) + 0.5) / times
        columns_px = (np.arange(crop_camera.width)[:, None] + steps).ravel()
        rows_px = (np.arange(crop_camera.height)[:, None] + steps).ravel()
        points_px = np.stack(np.meshgrid(columns_px, rows_px), axis=-1)
        # From meters to dots; the center of the first dot is (0, 0).
        at = on_page(pose, crop_camera, points_px, x_m) / (shrink * page.dot_m) - 0.5
        seen = cv2.remap(
            shrunk[shrink],
            at[..., 0].astype(np.float32),
            at[..., 1].astype(np.float32),
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=PAPER,
        )
        shape = crop_camera.height, times, crop_camera.width, times
        return np.asarray(seen, np.float64).reshape(shape).mean(axis=(1, 3))

    return view


def _shrunk(light: Float64, times: int) -> NDArray[np.float32]:
    """Average blocks of `times` x `times` dots."""
    rows, columns = (size // times * times for size in light.shape)
    blocks = light[:rows, :columns].reshape(rows // times, times, columns // times, times)
    return blocks.mean(axis=(1, 3)).astype(np.float32)
