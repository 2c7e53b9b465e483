"""Dense optical flow: flow of all pixels over the window, from its events and earlier ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sensor import Events
from sensor.events import concatenate
from tasks.dense_flow import DenseFlowSample, flow_at
from tasks.evaluation.answers import ask, flow_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import DenseFlow
from tasks.evaluation.source import Source
from tasks.methods import load_method


class DenseFlowScorer:
    """Scores the flow at all points."""

    def __init__(self, source: Source, task: DenseFlow) -> None:
        self._task = task
        start_us, end_us = source.window.start_us, source.window.end_us
        self._windows = (source.before_us(), start_us), (start_us, end_us)
        self._points = source.points(task)
        self._parts: tuple[list[Events], list[Events]] = [], []

    def push(self, events: Events) -> None:
        """Keep the events of both windows."""
        for window, parts in zip(self._windows, self._parts, strict=True):
            inside = events.between(*window)
            if len(inside) or not parts:
                parts.append(inside.copy())  # a slice would keep all events in memory

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method and point."""
        points = self._points
        before, during = map(concatenate, self._parts)
        self._parts = [], []
        sample = DenseFlowSample(before, during, points.centers_px, points.initial_px)
        for name in self._task.methods:
            method = load_method("dense_flow", name, self._task.weights)
            answer, cpu_s = ask("dense_flow", name, method, sample)
            estimate = flow_answer("dense_flow", name, answer, np.zeros(sample.shape))
            flow_px = flow_at(estimate.flow, points.centers_px)
            for k, item in enumerate(points.items):
                yield Score(
                    name,
                    points.value(k, flow_px[k]),
                    item=item,
                    failure=estimate.failure,
                    events=len(before) + len(during),
                    cpu_s=cpu_s,
                    copied=k > 0,  # one answer for all points
                    metric=points.metric,
                )
