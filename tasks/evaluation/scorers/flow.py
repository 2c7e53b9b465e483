"""Optical flow: how far patches move over the window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from sensor import Events
from sensor.events import concatenate
from tasks.evaluation.answers import ask, flow_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import Flow
from tasks.evaluation.source import Source
from tasks.flow import flow_sample, patch_mask
from tasks.methods import load_method
from tasks.methods.contrast_maximization import determined, estimate, off_grid
from tasks.registry import TASKS


class FlowScorer:
    """Scores the flow at all points, for each kind of patch."""

    def __init__(self, source: Source, task: Flow) -> None:
        self._source, self._task, self._points = source, task, source.points(task)
        self._mask = patch_mask(self._points.centers_px, max(self._points.sides), *source.size)
        self._parts: list[Events] = []

    def push(self, events: Events) -> None:
        """Keep the window's events in the patches."""
        window = events.between(self._source.window.start_us, self._source.window.end_us)
        if len(window) or not self._parts:
            self._parts.append(window.where(self._mask[window.y, window.x]))

    def scores(self) -> Iterator[Score]:
        """Yield one score for each kind of patch, point and method."""
        source, points = self._source, self._points
        methods = {name: load_method("flow", name) for name in self._task.methods}
        specs = {name: TASKS["flow"].method(name) for name in methods}
        from_zero = source.search_from == "zero"
        for name, spec in specs.items():
            if from_zero and spec.place.startswith("tasks.methods.contrast_maximization:"):
                methods[name] = partial(determined, methods[name])
        near = {name for name, spec in specs.items() if "guess" in spec.needs}
        log_image, events = source.log_image(), concatenate(self._parts)
        self._parts = []
        for side_px, variants in points.sides.items():
            for k, item in enumerate(points.items):
                sample = nearby = flow_sample(
                    events,
                    source.window.start_us,
                    source.window.end_us,
                    log_image=log_image,
                    contrast_threshold=source.contrast_threshold,
                    center_px=points.centers_px[k],
                    side_px=side_px,
                    initial=points.initial_px[k],
                    initial_sigma_px=points.sigma_px,
                )
                if from_zero and near:
                    nearby = replace(sample, initial=estimate(off_grid(sample)).flow)
                for name, method in methods.items():
                    given = nearby if name in near else sample
                    answer, cpu_s = ask("flow", name, method, given)
                    checked = flow_answer("flow", name, answer, given.initial)
                    value = points.value(k, checked.flow)
                    for variant in variants:
                        yield Score(
                            name,
                            value,
                            variant,
                            item,
                            checked.failure,
                            events=len(sample.t),
                            cpu_s=cpu_s,
                            copied=variant != variants[0],
                            metric=points.metric,
                        )
