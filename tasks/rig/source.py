"""`CropSource`: windows of a crop as a source for scorers; its light is that of the page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane, Trajectory
from sensor import Events
from sensor.levels import DARK_SHARE
from tasks.evaluation import source
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import DenseFlow, Flow, TaskSettings, Tracking, Video
from tasks.evaluation.source import Float64, FlowPoints, Images, Source, true_points
from tasks.flow import Features
from tasks.reconstruction import log_white_level
from tasks.rig.page import page_views
from tasks.rig.prints import Print, Way, Window, are_inside
from tasks.tracking import path_at
from tasks.video import picture

MAX_ITEMS = 1_000_000
"""Items of a task in a visit to a place."""

_MARGIN_US = 20_000  # a path lasts 14 ms, and has a control pose before it and one after it


@dataclass(eq=False, kw_only=True)
class CropSource(Source):
    """A window of a crop, or all of its windows as one stretch for tasks with a state."""

    name: str
    contrast_threshold: float
    cutoff_hz: float
    scene: str
    way: Way
    printed: Print
    events: Events
    windows: Sequence[Window]

    def __post_init__(self) -> None:
        self._first, self._pose = self.windows[0], self.way.pose
        self.window = source.Window(self._first.start_us, self.windows[-1].end_us)
        self.size = self._pose.camera.width, self._pose.camera.height
        view = page_views(self._pose, self.printed.page, self.printed.light)
        self._log_view = cache(lambda x_m: np.log(view(x_m) + DARK_SHARE))

    def camera(self) -> Camera:
        return self._pose.camera

    def plane(self) -> Plane:
        return Plane(normal=(0.0, 0.0, -1.0), offset_m=0.0)

    def log_image(self) -> Float64:
        return self._log_view(self._first.x_m[0])

    log_start = log_image

    def log_end(self) -> Float64:
        return self._log_view(self._first.x_m[1])

    def log_white(self) -> float:
        return log_white_level(self.log_end())

    def covers(self, task: TaskSettings) -> bool:
        """Return whether the recording lasts long enough around the window for a task."""
        way, window = self.way, self.window
        if any(each.windows_before for each in task.plan()) and window.before_us < way.first_us:
            return False
        if not isinstance(task, Tracking):
            return True
        slider_us, end_us = way.slider.t_us, window.start_us + _MARGIN_US + task.delay_us
        return bool(slider_us[0] <= window.start_us - _MARGIN_US and end_us <= slider_us[-1])

    def parts(self) -> Iterator[Events]:
        yield self.events

    def corners(self, count: int) -> tuple[NDArray[np.intp], Float64, Float64]:
        """Return numbers, (N,), pixels and displacements, (N, 2), of corners that stay in the crop.

        A corner of the print has the same number in all crops.
        """
        points_m = self.printed.corners_m(self._first.place)[:count]
        start_px, end_px = self._pose.project(points_m, self._first.x_m)
        inside = are_inside(self.camera(), start_px) & are_inside(self.camera(), end_px)
        return np.flatnonzero(inside), start_px[inside], (end_px - start_px)[inside]

    def points(self, task: Flow | DenseFlow) -> FlowPoints:
        numbers, centers_px, flow_px = self.corners(task.features)
        rng = np.random.default_rng([task.seed, self._first.place, self._first.back])
        draws = rng.standard_normal((task.features, 2))[numbers]
        return true_points(Features(*self.size, centers_px, flow_px, draws), task, numbers.tolist())

    def images(self, task: Video) -> Images:
        windows, shape = self.windows, self.size[::-1]
        return Images(
            numbers={window.end_us: i for i, window in enumerate(windows)},
            step_us=None,
            truth=lambda i, name: picture(self._log_view(windows[i].x_m[1]), shape, name),
        )

    def path(self, task: Tracking) -> Trajectory:
        return path_at(self.pose, 0.0)

    def pose(self, t_s: Float64) -> Float64:
        return self._pose.at(self.way.slider.position_m(self.window.start_us + 1e6 * t_s))

    def seeds(self, task: Tracking) -> tuple[list[int], int]:
        return [task.seed, self._first.place, self._first.back], 0

    def columns(self, score: Score) -> dict[str, Any]:
        window = self.windows[score.sample or 0]
        count = len(self.events.between(window.start_us, window.end_us))
        return {
            "scene": self.scene,
            "cutoff_hz": self.cutoff_hz,
            "speed": round(window.encoder_mps * self._pose.scale, 4),
            "sample": window.place,
            "event_rate_hz": 1e6 * count / (window.end_us - window.start_us),
            "item": window.visit * MAX_ITEMS + score.item,
            "t_us": window.end_us,
        }
