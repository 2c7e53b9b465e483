"""The light that a crop of a rig saw: views of its page from the solved poses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tasks.errors import RigError
from tasks.footage import Footage
from tasks.rig import slider as slider_files
from tasks.rig.calibration import on_page
from tasks.rig.crop import read_crop, span_of_events
from tasks.rig.page import read_print
from tasks.rig.page_view import page_views

_STEP_PX = 0.5  # motion between two frames of the light
_STEP_US = 100.0  # time between two positions of which the motion is known
_MAX_STEPS = 1000
_NEAR_M = 1e-4  # on both sides of a position of the slider, for the motion there


def light_of_crop(folder: Path) -> Footage:
    """Return the light of a crop during its fastest motion, in steps of half a pixel."""
    cropped = read_crop(folder)
    camera, pose = cropped.camera(), cropped.pose.pose()
    slider = slider_files.read_slider(folder / slider_files.FILE_NAME)
    page, light = read_print(folder)
    first_us, last_us = span_of_events(folder)
    t_us = np.arange(max(first_us, slider.t_us[0]), min(last_us, slider.t_us[-1]), _STEP_US)
    if len(t_us) < 2:
        raise RigError(f"{folder}: the events and the slider's readings do not overlap in time")
    x_m = slider.position_m(t_us)
    # Of points in view: a lens compresses the way of one that leaves the middle of the image.
    at_m = on_page(pose, camera, camera.grid(3), float(x_m.mean()))
    ends_px = pose.project(camera, at_m, x_m.mean() + np.array([-_NEAR_M, _NEAR_M]))
    px_per_m = float(np.linalg.norm(ends_px[1] - ends_px[0], axis=1).max()) / (2 * _NEAR_M)
    way = np.abs(np.diff(x_m)).cumsum() * px_per_m / _STEP_PX
    steps = int(way[-1])
    if steps < 2:
        raise RigError(f"{folder}: the image moves only {_STEP_PX * way[-1]:.2g} px in all")
    knots_us = np.interp(np.arange(steps + 1), np.concatenate([[0.0], way]), t_us)
    length = min(_MAX_STEPS, steps)
    start = int(np.argmin(knots_us[length:] - knots_us[:-length]))
    chosen_us = knots_us[start : start + length + 1]
    positions_m = slider.position_m(chosen_us)

    def frames() -> Iterator[NDArray[np.float32]]:
        view = page_views(camera, pose, page, light)
        for x in positions_m.tolist():
            yield view(x).astype(np.float32)

    offset_us = int(chosen_us[0])
    return Footage(
        path=folder,
        t_s=1e-6 * (chosen_us - offset_us),
        t_offset_us=offset_us,
        height=camera.height,
        width=camera.width,
        encoding="linear",
        white_level=1.0,
        frames=frames,
    )
