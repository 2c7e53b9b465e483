"""Camera pose tracking: the path over the first milliseconds of the window."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from sensor import Events
from sensor.events import concatenate
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.answers import blamed, path_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.methods import load_method
from tasks.tracking import path_at, perturbed, position_error_mm, succeeded, tracking_sample

_PIXELS_PER_EVENT = 2  # of a method's most events: keeps what is collected small


class TrackingScorer:
    """Position error of the path, for each size of the initial error."""

    def __init__(self, light: ReferenceFrames, setting: Setting) -> None:
        self._light, self._setting = light, setting
        config = light.evaluate.tracking
        model = setting.model
        # The time of the path is that of the events, which the camera runs through faster.
        self._truth = path_at(self._pose, 0.0)
        duration_us = round(self._truth.duration_s * 1e6)
        self._end_us = setting.start_us + duration_us + config.max_delay_us
        self._max_events = round(config.max_events * (1 + config.max_delay_us / duration_us))
        self._kept = np.zeros((model.height, model.width), bool)
        rng = np.random.default_rng([config.seed, light.sequence.manifest.clip])
        chosen = rng.permutation(self._kept.size)[: _PIXELS_PER_EVENT * config.max_events]
        self._kept.ravel()[chosen] = True
        self._parts: list[Events] = []

    def _pose(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        start_s = self._light.sequence.window_s[0]
        return self._light.truth.trajectory.pose(start_s + t_s * self._setting.speed)

    def push(self, events: Events) -> None:
        """Keep the path's events at the chosen pixels."""
        early = events.between(self._setting.start_us, self._end_us)
        if len(early) or not self._parts:
            self._parts.append(early.where(self._kept[early.y, early.x]))

    def scores(self) -> Iterator[Score]:
        """One score a method and size of the initial error."""
        config, clip = self._light.evaluate.tracking, self._light.sequence.manifest.clip
        model = self._setting.model
        events = concatenate(self._parts)
        self._parts = []
        seed = int(np.random.SeedSequence([config.seed, clip]).generate_state(1)[0])
        for sigma_mm in config.sigmas_mm:
            sample = tracking_sample(
                events,
                self._setting.start_us,
                self._light.log_images[model.width],
                model.contrast_threshold,
                self._light.truth.camera(model.width),
                self._light.truth.plane,
                self._pose(np.zeros(1))[0],
                perturbed(self._truth, 1e-3 * sigma_mm, seed),
                1e-3 * sigma_mm,
                max_events=self._max_events,
                max_delay_us=config.max_delay_us,
                seed=seed,
            )
            initial_mm = self._error_mm(sample.initial)
            for name in config.methods:
                method = load_method("tracking", name)
                started_s = time.thread_time()
                with blamed("tracking", name):
                    answer = method(sample)
                cpu_s = time.thread_time() - started_s
                estimate = path_answer(name, sample, answer)
                error_mm = self._error_mm(estimate.path)
                moved = estimate.path is not sample.initial
                lost = moved and not succeeded(estimate, error_mm, initial_mm)
                failure = estimate.failure or ("ended far off" if lost else "")
                yield Score(
                    "tracking",
                    name,
                    "position_error_mm",
                    error_mm,
                    variant=f"sigma {sigma_mm:g} mm",
                    failure=failure,
                    events=len(sample.t_us),
                    cpu_s=cpu_s,
                )

    def _error_mm(self, path: Trajectory) -> float:
        return position_error_mm(path, self._pose, 0.0, self._truth.duration_s)
