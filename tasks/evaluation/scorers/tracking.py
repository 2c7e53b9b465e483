"""Camera pose tracking: the path over the first milliseconds of the window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eres_render import Trajectory
from sensor import Events
from sensor.events import concatenate
from tasks.errors import TaskError
from tasks.evaluation.answers import ask, path_answer
from tasks.evaluation.distance import farther
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import Tracking
from tasks.methods import load_method
from tasks.tracking import (
    KNOT_INTERVAL_S,
    PATH_S,
    failure_of,
    most_pixels,
    path_at,
    perturbed,
    position_error_mm,
    random_ranks,
    tracking_sample,
)
from tasks.variants import sigma_variant

_EVENTS_KEPT = 4  # how many times the events of a sample to keep at most


class TrackingScorer:
    """Scores the position error of the path, for each size of the initial error."""

    def __init__(self, reference: ReferenceFrames, setting: Setting, task: Tracking) -> None:
        self._reference, self._setting, self._task = reference, setting, task
        model, plane = setting.model, reference.truth.plane
        self._plane = plane and replace(plane, offset_m=setting.scale * plane.offset_m)
        _check_path(
            reference.sequence.window_s[0], reference.truth.trajectory.duration_s, setting.speed
        )
        # The path is in the events' time: a faster camera runs through it sooner.
        self._truth = path_at(self._pose, 0.0)
        duration_us = round(self._truth.duration_s * 1e6)
        self._end_us = setting.start_us + duration_us + task.max_delay_us
        _check_frames(reference, setting, task, duration_us)
        self._max_events = round(task.max_events * (1 + task.max_delay_us / duration_us))
        seed = np.random.SeedSequence([task.seed, reference.sequence.manifest.clip])
        self._seed = int(seed.generate_state(1)[0])
        self._ranks = random_ranks(self._seed, model.height, model.width)
        self._pixels = self._ranks.size  # of the lowest ranks; the sample has no others
        self._parts: list[Events] = []

    def _pose(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        truth, start_s = self._reference.truth, self._reference.sequence.window_s[0]
        poses = truth.trajectory.pose(start_s + t_s * self._setting.speed)
        poses[..., :3, 3] *= self._setting.scale
        if self._setting.distance == 1.0 or self._plane is None:
            return poses
        return farther(poses, self._plane, self._setting.distance)

    def push(self, events: Events) -> None:
        """Keep the path's events at the pixels that the sample may have."""
        early = events.between(self._setting.start_us, self._end_us)
        if len(early) or not self._parts:
            self._parts.append(early.where(self._rank(early) < self._pixels))
        if sum(map(len, self._parts)) > _EVENTS_KEPT * self._max_events:
            kept = concatenate(self._parts)
            rank = self._rank(kept)
            self._pixels = most_pixels(rank, self._max_events)
            self._parts = [kept.where(rank < self._pixels)]

    def _rank(self, events: Events) -> NDArray[np.int32]:
        return self._ranks[events.y, events.x]

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method and size of the initial error."""
        task, model = self._task, self._setting.model
        camera = self._reference.camera(model.width, model.height)
        if self._setting.distance != 1.0:
            camera = camera.zoomed(self._setting.distance)
        events = concatenate(self._parts)
        self._parts = []
        for sigma_mm in task.sigmas_mm:
            sample = tracking_sample(
                events,
                self._setting.start_us,
                log_image=self._reference.log_image(model),
                contrast_threshold=model.contrast_threshold,
                camera=camera,
                plane=self._plane,
                T_0=self._pose(np.zeros(1))[0],
                initial=perturbed(self._truth, 1e-3 * sigma_mm, self._seed),
                initial_sigma_m=1e-3 * sigma_mm,
                max_events=self._max_events,
                max_delay_us=task.max_delay_us,
                seed=self._seed,
            )
            initial_mm = self._error_mm(sample.initial)
            for name in task.methods:
                method = load_method("tracking", name)
                answer, cpu_s = ask("tracking", name, method, sample)
                estimate = path_answer(name, sample, answer)
                error_mm = self._error_mm(estimate.path)
                yield Score(
                    name,
                    error_mm,
                    variant=sigma_variant(sigma_mm),
                    failure=failure_of(estimate, sample.initial, error_mm, initial_mm),
                    events=len(sample.t_us),
                    cpu_s=cpu_s,
                )

    def _error_mm(self, path: Trajectory) -> float:
        return position_error_mm(path, self._pose, 0.0, self._truth.duration_s)


def _check_path(start_s: float, end_s: float, speed: float) -> None:
    """Refuse windows around whose path that of the scene has no room for a knot on each side."""
    before_s = KNOT_INTERVAL_S * speed
    if start_s < before_s - 1e-9:
        raise TaskError(
            f"tracking: found a window that starts at {start_s:g} s of the path, expected "
            f"{before_s:g} s or later, one knot after the path's start; render clips, without "
            "--continuous"
        )
    until_s = start_s + (PATH_S + KNOT_INTERVAL_S) * speed
    if end_s < until_s - 1e-9:
        raise TaskError(
            f"tracking: found a path that ends at {end_s:g} s, expected {until_s:g} s or later, at "
            f"speed {speed:g} one knot after the path that is tracked; lower the speed"
        )


def _check_frames(
    reference: ReferenceFrames, setting: Setting, task: Tracking, duration_us: int
) -> None:
    """Refuse frames that end before the path, or before its last events come."""
    shown_us = round(1e6 * float(reference.sequence.t_s[-1]) / setting.speed) - setting.start_us
    delay_us = task.delay_us
    if duration_us + delay_us > shown_us + 1:
        delayed = f", and {1e-3 * delay_us:g} ms for delays" if delay_us else ""
        raise TaskError(
            f"tracking: found {1e-3 * shown_us:g} ms of frames from the start of the window on, at "
            f"speed {setting.speed:g}, expected {1e-3 * duration_us:g} ms for the path{delayed}; "
            "lower the speed"
        )
