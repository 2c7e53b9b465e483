"""A print with the places and corners at which all of its crops are scored.

At each speed, each distance is scored where the others are, so that differences between distances
are of the same points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera
from eres_render.errors import reading
from tasks.errors import RigError
from tasks.flow import MARGIN_PX, REFERENCE_WIDTH_PX, corners
from tasks.rig import slider as slider_files
from tasks.rig.calibration import on_page
from tasks.rig.crop import Cropped, span_of_events
from tasks.rig.page import Page, read_print
from tasks.rig.page_view import page_views
from tasks.rig.places import Way

Float64 = NDArray[np.float64]

_SAME_FIELD = 1.1  # ratio of the widths of two fields, on the page


@dataclass(frozen=True, eq=False, slots=True)
class Print:
    """A print, and the places on it.

    Parameters
    ----------
    light
        (H, W) its reflectance.
    travel_m
        Travel in a window, m.
    places_m
        (K,) positions along the print of the middles of windows, m.
    """

    page: Page
    light: Float64
    nearest: Cropped
    ways: Mapping[Path, Way]
    way: Way
    travel_m: float
    places_m: Float64
    _corners_m: dict[int, Float64] = field(init=False, default_factory=dict)

    def corners_m(self, place: int) -> Float64:
        """Return corners of the picture, (N, 2) m on the page, the strongest first.

        They are in the nearest crop throughout a window at the place, with their patches.
        """
        if place not in self._corners_m:
            camera, pose = self.nearest.camera(), self.nearest.pose.pose()
            margin_px = MARGIN_PX * camera.width / REFERENCE_WIDTH_PX
            x_m = float(self.way.slider_m(self.places_m[place]))
            view = page_views(camera, pose, self.page, self.light)(x_m)
            points_m = on_page(pose, camera, corners(view, margin_px), x_m)
            left, top, right, bottom = self.page.picture_m
            x, y = points_m.T
            inside = (x > left) & (x < right) & (y > top) & (y < bottom)
            for side in (-1, 1):
                at_m = x_m + side * 0.5 * self.travel_m / pose.scale
                inside &= are_inside(camera, pose.project(camera, points_m, at_m), margin_px)
            self._corners_m[place] = points_m[inside]
        return self._corners_m[place]


def are_inside(camera: Camera, points_px: Float64, margin_px: float = 0.0) -> NDArray[np.bool_]:
    """Return which points are in a camera's image.

    Parameters
    ----------
    points_px
        (..., 2) px.
    margin_px
        Least distance from the sides, px.

    Returns
    -------
    (...) bool.
    """
    size = np.array([camera.width, camera.height])
    inside = (points_px > margin_px) & (points_px < size - margin_px)
    return np.asarray(np.all(inside, axis=-1))


def prints_of(crops: Mapping[Path, Cropped], places: int, travel_m: float) -> dict[str, Print]:
    """Return the print of each picture.

    Parameters
    ----------
    places
        Number of places, evenly spaced over the part of the print that all its crops pass.
    travel_m
        Travel in a window, m.
    """
    scenes: dict[str, dict[Path, Cropped]] = {}
    for folder, cropped in crops.items():
        scenes.setdefault(cropped.scene, {})[folder] = cropped
    return {scene: _print_of(scene, of, places, travel_m) for scene, of in scenes.items()}


def _print_of(scene: str, crops: Mapping[Path, Cropped], places: int, travel_m: float) -> Print:
    folder = max(crops, key=lambda path: crops[path].width)  # of the field that all of them show
    page, light = read_print(folder)
    field_m = _field_m(crops[folder])
    for other in [path for path in crops if path != folder]:
        other_page, other_light = read_print(other)
        if other_page != page or not np.array_equal(other_light, light):
            raise RigError(
                f"{other}: its page is not the page of {folder}; evaluate each print separately"
            )
        other_field_m = _field_m(crops[other])
        if not 1 / _SAME_FIELD < other_field_m / field_m < _SAME_FIELD:
            raise RigError(
                f"{other}: its field is {1e3 * other_field_m:.3g} mm wide, but in {folder} it is "
                f"{1e3 * field_m:.3g} mm; crop all recordings of a print with one `eres rig crop`"
            )
    direction = crops[folder].pose.pose().direction[:2]
    along = direction / np.linalg.norm(direction)
    ways = {path: _way_of(path, cropped, along) for path, cropped in crops.items()}
    places_m = _evenly(scene, ways, places, travel_m)
    return Print(page, light, crops[folder], ways, ways[folder], travel_m, places_m)


def _field_m(cropped: Cropped) -> float:
    """Return the width of the part of the page in the middle row of a crop, m."""
    middle = 0.5 * cropped.height
    ends_px = np.array([[0.0, middle], [cropped.width, middle]])
    left, right = on_page(cropped.pose.pose(), cropped.camera(), ends_px, 0.0)
    return float(np.linalg.norm(right - left))


def _way_of(folder: Path, cropped: Cropped, along: Float64) -> Way:
    file = folder / slider_files.FILE_NAME
    slider = slider_files.read_slider(file)
    with reading(file, "the way of a slider", RigError):
        return Way.of(cropped, slider, span_of_events(folder), along)


def _evenly(scene: str, ways: Mapping[Path, Way], places: int, travel_m: float) -> Float64:
    """Return positions evenly spaced over the part of a print that all crops pass, (K,) m."""
    spans_m = {folder: way.span_m for folder, way in ways.items()}
    first_m = max(first for first, _ in spans_m.values())
    last_m = min(last for _, last in spans_m.values())
    shared_m = max(0.0, last_m - first_m)
    most = int(shared_m / travel_m * (1 - 1e-9))  # the first window begins after the first reading
    if places > most:
        length_m, shortest = min((last - first, path) for path, (first, last) in spans_m.items())
        raise RigError(
            f"evaluate: {scene}: found room for {most} windows of {1e3 * travel_m:g} mm on the "
            f"{1e3 * shared_m:.3g} mm that all recordings pass ({shortest} passes "
            f"{1e3 * length_m:.3g} mm), expected room for {places}; reduce --places or --travel"
        )
    return np.asarray(first_m + (np.arange(places) + 0.5) / places * shared_m)
