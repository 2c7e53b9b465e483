"""A print, its places and corners at which all crops are scored, and when a crop is there.

At each speed, each distance is scored where the others are, so that differences between distances
are of the same points.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render import Camera
from eres_render.errors import reading
from sensor.formats import read_events
from tasks.errors import RigError
from tasks.flow import MARGIN_PX, REFERENCE_WIDTH_PX, corners
from tasks.rig.bundle import RigPose
from tasks.rig.crop import EVENTS_NAME, Cropped
from tasks.rig.page import Page, page_views, read_print
from tasks.rig.recording import span_us
from tasks.rig.slider import SLIDER_FILE, Float64, Slider, read_slider

_EVEN = 1e-3  # largest deviation from constant speed in a window, as a fraction of the travel
_EVEN_IN_STEPS = 5e-3  # the same where the encoder's steps are coarser
_CHECKED = 5  # positions in a window
_APART_M = 0.1  # two positions of the slider, between which the page is a straight line
_SAME_FIELD = 1.1  # ratio of the widths of two fields, on the page


@dataclass(frozen=True, slots=True)
class Window:
    """A time window of constant speed at a place, and the encoder's readings at its ends.

    `visit` is 2 n on the carriage's way there, for the nth time from 0, and 2 n + 1 on its way
    back.
    """

    place: int
    visit: int
    start_us: int
    end_us: int
    x_m: tuple[float, float]

    @property
    def back(self) -> int:
        """1 on the carriage's way back, and 0 on its way there."""
        return self.visit % 2

    @property
    def encoder_mps(self) -> float:
        """Speed by the encoder, whose scale `eres rig solve --scale` finds."""
        return 1e6 * abs(self.x_m[1] - self.x_m[0]) / (self.end_us - self.start_us)


@dataclass(eq=False, slots=True)
class Way:
    """Which part of the print is in the middle of a crop at each position of its slider.

    The position along the print is `begin_m` at the slider's 0 and changes by `slope` times the
    slider's change. `span_m` is its range during the events.
    """

    slider: Slider
    first_us: int
    last_us: int
    pose: RigPose
    begin_m: float
    slope: float
    span_m: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        t_us, x_m = self.slider.t_us, self.slider.x_m
        self.first_us = max(self.first_us, math.ceil(t_us[0]))
        self.last_us = min(self.last_us, math.floor(t_us[-1]))
        if self.first_us >= self.last_us:
            raise RigError("slider: the readings and the events do not overlap in time")
        inside = x_m[(t_us >= self.first_us) & (t_us <= self.last_us)]
        x = [*self.slider.position_m([self.first_us, self.last_us]).tolist(), *inside.tolist()]
        if min(x) == max(x):
            raise RigError(f"slider: the carriage stays at {x[0]:g} m during the events")
        low_m, high_m = sorted(self.begin_m + self.slope * end for end in (min(x), max(x)))
        self.span_m = low_m, high_m

    def slider_m(self, position_m: ArrayLike) -> Float64:
        """Return the slider's positions, m, at positions along the print, m."""
        return np.asarray((np.asarray(position_m) - self.begin_m) / self.slope)

    def windows(self, places_m: Float64, travel_m: float) -> list[Window]:
        """Return the windows of constant speed around places, in the order of their starts."""
        half_m = 0.5 * travel_m / self.pose.scale
        moves_m = np.abs(np.diff(self.slider.x_m))
        step = float(moves_m[moves_m > 0].min()) / (2 * half_m)
        uneven_m = 2 * half_m * min(max(step, _EVEN), _EVEN_IN_STEPS)
        windows: list[Window] = []
        for place, middle_m in enumerate(self.slider_m(places_m).tolist()):
            passed: Counter[bool] = Counter()
            for start, end, rises in _passes(self.slider, middle_m - half_m, middle_m + half_m):
                start_us, end_us = round(start), round(end)
                back = rises != (self.slope > 0)
                visit = 2 * passed[back] + back
                passed[back] += 1
                if not self.first_us <= start_us < end_us <= self.last_us:
                    continue
                x = self.slider.position_m(np.linspace(start_us, end_us, _CHECKED))
                if np.max(np.abs(x - np.linspace(x[0], x[-1], _CHECKED))) < uneven_m:
                    at = float(x[0]), float(x[-1])
                    windows.append(Window(place, visit, start_us, end_us, at))
        return sorted(windows, key=lambda window: window.start_us)


def _passes(slider: Slider, low_m: float, high_m: float) -> list[tuple[float, float, bool]]:
    """Return start and end, us, of each way between two positions, and whether it is upward.

    When a jittering encoder crosses a position several times, the crossings next to the way count.
    """
    crossings = sorted(_crossings(slider, low_m) + _crossings(slider, high_m))
    return [(start, end, b > a) for (start, a), (end, b) in pairwise(crossings) if a != b]


def _crossings(slider: Slider, x_m: float) -> list[tuple[float, float]]:
    """Return the times at which the carriage crosses a position, us, each with the position."""
    beyond = slider.x_m >= x_m
    k = np.flatnonzero(beyond[1:] != beyond[:-1])
    share = (x_m - slider.x_m[k]) / (slider.x_m[k + 1] - slider.x_m[k])
    times_us = slider.t_us[k] + share * (slider.t_us[k + 1] - slider.t_us[k])
    return [(t_us, x_m) for t_us in times_us.tolist()]


@dataclass(frozen=True, eq=False, slots=True)
class Print:
    """A print: its reflectance, (H, W), and the middles, (K,), of windows of `travel_m` on it."""

    page: Page
    light: Float64
    ways: Mapping[Path, Way]
    nearest: Way
    travel_m: float
    places_m: Float64
    _corners_m: dict[int, Float64] = field(init=False, default_factory=dict)

    def corners_m(self, place: int) -> Float64:
        """Return corners of the picture, (N, 2) m on the page, the strongest first.

        They are in the nearest crop throughout a window at the place, with their patches.
        """
        if place not in self._corners_m:
            pose, camera = self.nearest.pose, self.nearest.pose.camera
            margin_px = MARGIN_PX * camera.width / REFERENCE_WIDTH_PX
            x_m = float(self.nearest.slider_m(self.places_m[place]))
            view = page_views(pose, self.page, self.light)(x_m)
            points_m = pose.on_page(corners(view, margin_px), x_m)
            left, top, right, bottom = self.page.picture_m
            x, y = points_m.T
            inside = (x > left) & (x < right) & (y > top) & (y < bottom)
            ends_m = x_m + np.array([-0.5, 0.5]) * self.travel_m / pose.scale
            inside &= are_inside(camera, pose.project(points_m, ends_m), margin_px).all(axis=0)
            self._corners_m[place] = points_m[inside]
        return self._corners_m[place]


def are_inside(camera: Camera, points_px: Float64, margin_px: float = 0.0) -> NDArray[np.bool_]:
    """Return which points, (..., 2) px, are in a camera's image by more than a margin."""
    size = np.array([camera.width, camera.height])
    inside = (points_px > margin_px) & (points_px < size - margin_px)
    return np.asarray(np.all(inside, axis=-1))


def prints_of(crops: Mapping[Path, Cropped], places: int, travel_m: float) -> dict[str, Print]:
    """Return the print of each picture, with places evenly along the part that all crops pass."""
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
    direction = crops[folder].view().direction[:2]
    along = direction / np.linalg.norm(direction)
    ways = {path: _way_of(path, cropped, along) for path, cropped in crops.items()}
    return Print(page, light, ways, ways[folder], travel_m, _evenly(scene, ways, places, travel_m))


def _field_m(cropped: Cropped) -> float:
    """Return the width of the part of the page in the middle row of a crop, m."""
    middle = 0.5 * cropped.height
    ends_px = np.array([[0.0, middle], [cropped.width, middle]])
    left, right = cropped.view().on_page(ends_px, 0.0)
    return float(np.linalg.norm(right - left))


def _way_of(folder: Path, cropped: Cropped, along: Float64) -> Way:
    """Return the way of a crop; `along` is the unit vector of the travel on the page, (2,)."""
    file = folder / SLIDER_FILE
    slider, pose = read_slider(file), cropped.view()
    middle_px = 0.5 * np.array([[cropped.width, cropped.height]])
    begin_m, end_m = (float(pose.on_page(middle_px, x)[0] @ along) for x in (0.0, _APART_M))
    with reading(file, "the way of a slider", RigError):
        ends_us = span_us(folder / EVENTS_NAME, read_events(folder / EVENTS_NAME))
        return Way(slider, *ends_us, pose, begin_m, (end_m - begin_m) / _APART_M)


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
