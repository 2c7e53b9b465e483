"""Camera pose tracking: the path over the first milliseconds of the window."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from sensor import Events
from sensor.events import concatenate
from tasks import tracking
from tasks.evaluation.answers import ask, path_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import Tracking
from tasks.evaluation.source import Source
from tasks.methods import load_method
from tasks.registry import sigma_variant

_EVENTS_KEPT = 4  # how many times the events of a sample to keep at most


class TrackingScorer:
    """Scores the position error of the path, for each size of the initial error."""

    def __init__(self, source: Source, task: Tracking) -> None:
        self._source, self._task = source, task
        self._truth = source.path(task)
        duration_us = round(self._truth.duration_s * 1e6)
        self._start_us = source.window.start_us
        self._end_us = self._start_us + duration_us + task.max_delay_us
        self._max_events = round(task.max_events * (1 + task.max_delay_us / duration_us))
        self._path_seed, self._seed = source.seeds(task)
        self._ranks = tracking.random_ranks(self._seed, *source.size[::-1])
        self._pixels = self._ranks.size  # of the lowest ranks; the sample has no others
        self._parts: list[Events] = []

    def push(self, events: Events) -> None:
        """Keep the path's events at the pixels that the sample may have."""
        early = events.between(self._start_us, self._end_us)
        if len(early) or not self._parts:
            self._parts.append(early.where(self._rank(early) < self._pixels))
        if sum(map(len, self._parts)) > _EVENTS_KEPT * self._max_events:
            stored = concatenate(self._parts)
            rank = self._rank(stored)
            self._pixels = tracking.most_pixels(rank, self._max_events)
            self._parts = [stored.where(rank < self._pixels)]

    def _rank(self, events: Events) -> NDArray[np.int32]:
        return self._ranks[events.y, events.x]

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method, size of the initial error and start."""
        source, task = self._source, self._task
        events = concatenate(self._parts)
        self._parts = []
        first = self._path_seed
        seeds = [first, *([*np.atleast_1d(first), k] for k in range(1, task.starts or 1))]
        for sigma_mm, (start, seed) in product(task.sigmas_mm, enumerate(seeds)):
            sample = tracking.tracking_sample(
                events,
                self._start_us,
                log_image=source.log_image(),
                contrast_threshold=source.contrast_threshold,
                camera=source.camera(),
                plane=source.plane(),
                T_0=source.pose(np.zeros(1))[0],
                initial=tracking.perturbed(self._truth, 1e-3 * sigma_mm, seed),
                initial_sigma_m=1e-3 * sigma_mm,
                max_events=self._max_events,
                max_delay_us=task.max_delay_us,
                seed=self._seed,
            )
            initial_mm = self._error_mm(sample.initial)
            for name in task.methods:
                answer, cpu_s = ask("tracking", name, load_method("tracking", name), sample)
                estimate = path_answer(name, sample, answer)
                error_mm = self._error_mm(estimate.path)
                yield Score(
                    name,
                    error_mm,
                    variant=sigma_variant(sigma_mm),
                    item=start,
                    failure=tracking.failure_of(estimate, sample.initial, error_mm, initial_mm),
                    events=len(sample.t_us),
                    cpu_s=cpu_s,
                )

    def _error_mm(self, path: Trajectory) -> float:
        return tracking.position_error_mm(path, self._source.pose, 0.0, self._truth.duration_s)
