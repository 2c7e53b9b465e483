"""Video: images at regular times along a continuous stretch, from events alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sensor import Events
from tasks.errors import TaskError
from tasks.evaluation.answers import ask, ask_each, image_answer
from tasks.evaluation.reference import ReferenceFrames, dark_level_of
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import Video, unlike_two_poles
from tasks.methods import load_method
from tasks.methods.e2vid import even_window_us
from tasks.methods.true_video import TrueLight
from tasks.psnr import psnr_db
from tasks.registry import TASKS
from tasks.variants import equalization_variant
from tasks.video import ImageTaker, picture


class VideoScorer:
    """Scores the PSNR of each image; each image is one sample."""

    def __init__(self, reference: ReferenceFrames, setting: Setting, task: Video) -> None:
        self._reference, self._setting, self._task = reference, setting, task
        others = task.other_equalizations or ()
        named = {equalization_variant(name): name for name in others}
        self._equalizations = {"": task.equalization, **named}
        model = setting.model
        size_and_C = model.width, model.height, model.contrast_threshold
        start_s, end_s = reference.sequence.window_s
        count = round((end_s - start_s) / task.every_s)
        if count < 1:
            raise TaskError(
                f"video: found {end_s - start_s:g} s of frames, expected at least "
                f"{task.every_s:g} s, for one image"
            )
        self._step_us = 1e6 * (end_s - start_s) / count
        self._times_s = np.linspace(start_s, end_s, count + 1)[1:].tolist()
        self._samples = {round(t_s / setting.speed * 1e6): i for i, t_s in enumerate(self._times_s)}
        self._takers = {}
        for name in task.methods:
            start = load_method("video", name, task.weights)
            method, _ = ask("video", name, start, *size_and_C, **self._options(name, setting))
            self._takers[name] = ImageTaker(method, self._samples)
        self._blank = np.zeros((model.height, model.width))
        self._scores: list[Score] = []
        # Events and CPU time since each method's last image.
        self._events = dict.fromkeys(self._takers, 0)
        self._cpu_s = dict.fromkeys(self._takers, 0.0)

    def _options(self, name: str, setting: Setting) -> dict[str, Any]:
        """Return the extra arguments of a method."""
        method = TASKS["video"].method(name)
        if method.role == "diagnostic":
            model = setting.model
            if found := unlike_two_poles(model):
                raise TaskError(
                    f"video, method {name!r}, which is about two poles: found "
                    f"{found}, expected 'two_pole' with one cutoff"
                )
            light = TrueLight(
                *(self._reference.sequence, dark_level_of(model)),
                *(model.cutoff_hz, setting.speed, model.fill_factor),
            )
            return {"light": light}
        if not method.network:
            return {}
        window_us = even_window_us(self._step_us)
        if name != "e2vid":
            return {"window_us": window_us / setting.speed}
        if self._task.e2vid_window_s is not None:
            window_us = 1e6 * self._task.e2vid_window_s
        return {
            "window_us": window_us / setting.speed,
            "events_per_px": self._task.e2vid_events_per_px,
        }

    def push(self, events: Events) -> None:
        """Pass the events on, and score the images that are due; keep no image, they are large."""
        for name, taker in self._takers.items():
            self._events[name] += len(events)
            self._score(name, ask_each("video", name, taker.take, events))

    def scores(self) -> Iterator[Score]:
        """Yield one score for each image and method."""
        for name, taker in self._takers.items():
            self._score(name, ask_each("video", name, taker.rest))
        yield from self._scores

    def _score(self, name: str, asked: Iterator[tuple[Any, float]]) -> None:
        for taken, cpu_s in asked:
            self._cpu_s[name] += cpu_s
            if taken is None:
                return
            t_us, answer = taken
            log_image, failure = image_answer("video", name, answer, self._blank)
            sample = self._samples[t_us]
            for variant, equalization in self._equalizations.items():
                truth = self._reference.picture(
                    self._setting.model, self._times_s[sample], equalization
                )
                found = picture(log_image, truth.shape, equalization)
                self._scores.append(
                    Score(
                        name,
                        psnr_db(found, truth),
                        variant,
                        failure=failure,
                        sample=sample,
                        events=self._events[name],
                        cpu_s=self._cpu_s[name],
                        copied=variant != "",
                    )
                )
            self._events[name], self._cpu_s[name] = 0, 0.0
