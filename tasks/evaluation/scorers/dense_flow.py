"""Dense optical flow: flow of all pixels over the window, from its events and earlier ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sensor import Events
from sensor.events import concatenate
from tasks.dense_flow import DenseFlowSample, flow_at
from tasks.errors import TaskError
from tasks.evaluation.answers import ask, flow_answer
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import DenseFlow
from tasks.flow import rnepe_px
from tasks.methods import load_method


class DenseFlowScorer:
    """Scores the end-point errors at all features."""

    def __init__(self, reference: ReferenceFrames, setting: Setting, task: DenseFlow) -> None:
        self._setting, self._task = setting, task
        self._before_us = 2 * setting.start_us - setting.end_us
        first_us = float(reference.sequence.t_s[0]) / setting.speed * 1e6
        if first_us > self._before_us + 1:
            start_s, end_s = reference.sequence.window_s
            if end_s > 2 * start_s:  # of all of the path, for example
                raise TaskError(
                    f"dense_flow: found a window from {start_s:g} to {end_s:g} s of the path, "
                    "expected one with as much of the path before it; render clips, without "
                    "--continuous"
                )
            raise TaskError(
                f"dense_flow: found frames from {first_us * 1e-6 * setting.speed:g} s on, expected "
                f"them from {2 * start_s - end_s:g} s on, one window earlier than the scored one; "
                "render the clip with a longer --warm-up"
            )
        size = setting.model.width, setting.model.height
        self._features = reference.features(task.features, task.seed).at(*size)
        self._before: list[Events] = []
        self._during: list[Events] = []

    def push(self, events: Events) -> None:
        """Keep the events of both windows."""
        start_us, end_us = self._setting.start_us, self._setting.end_us
        windows = (self._before_us, start_us), (start_us, end_us)
        for window, parts in zip(windows, (self._before, self._during), strict=True):
            found = events.between(*window)
            if len(found) or not parts:
                parts.append(found.copy())  # a slice would keep all events in memory

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method and feature."""
        features, width = self._features, self._setting.model.width
        before, during = concatenate(self._before), concatenate(self._during)
        self._before, self._during = [], []
        sample = DenseFlowSample(
            before,
            during,
            features.centers_px,
            features.initial_flow_px(self._task.initial_sigma_px),
        )
        for name in self._task.methods:
            method = load_method("dense_flow", name, self._task.weights)
            answer, cpu_s = ask("dense_flow", name, method, sample)
            estimate = flow_answer("dense_flow", name, answer, np.zeros(sample.shape))
            found_px = flow_at(estimate.flow, features.centers_px)
            for item in range(len(features)):
                error_px = rnepe_px(found_px[item], features.flow_px[item], width)
                yield Score(
                    name,
                    error_px,
                    item=item,
                    failure=estimate.failure,
                    events=len(before) + len(during),
                    cpu_s=cpu_s,
                    copied=item > 0,  # one answer for all features
                )
