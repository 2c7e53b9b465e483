"""Video: images at regular times along a continuous stretch, from events alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sensor import Events
from tasks.evaluation.answers import ask, ask_each, image_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import Video, has_windows_of_e2vid
from tasks.evaluation.source import Source
from tasks.methods import load_method
from tasks.methods.e2vid import even_window_us
from tasks.psnr import psnr_db
from tasks.registry import TASKS, equalization_variant
from tasks.video import ImageTaker, picture


class VideoScorer:
    """Scores the PSNR of each image; each image is one sample."""

    def __init__(self, source: Source, task: Video) -> None:
        self._source, self._task, self._images = source, task, source.images(task)
        others = {equalization_variant(name): name for name in task.other_equalizations or ()}
        self._equalizations = {"": task.equalization, **others}
        arguments = *source.size, source.contrast_threshold
        self._takers = {}
        for name in task.methods:
            start = load_method("video", name, task.weights)
            method, _ = ask("video", name, start, *arguments, **self._options(name))
            self._takers[name] = ImageTaker(method, self._images.numbers)
        self._blank = np.zeros(source.size[::-1])
        self._scores: list[Score] = []
        # Events and CPU time since each method's last image.
        self._events = dict.fromkeys(self._takers, 0)
        self._cpu_s = dict.fromkeys(self._takers, 0.0)

    def _options(self, name: str) -> dict[str, Any]:
        """Return the extra arguments of a method."""
        method = TASKS["video"].method(name)
        if method.role == "diagnostic":
            return {"light": self._source.true_light(name)}
        if not method.network or self._images.step_us is None:
            return {}
        options = {}
        window_us = even_window_us(self._images.step_us)
        if has_windows_of_e2vid(name):
            options["events_per_px"] = self._task.e2vid_events_per_px
            if self._task.e2vid_window_s is not None:
                window_us = 1e6 * self._task.e2vid_window_s
        return {"window_us": window_us / self._source.speed, **options}

    def push(self, events: Events) -> None:
        """Pass the events on, and score the images that are due; keep no image, they are large."""
        for name, taker in self._takers.items():
            self._events[name] += len(events)
            self._scores += self._scored(name, ask_each("video", name, taker.take, events))

    def scores(self) -> Iterator[Score]:
        """Yield one score for each image and method."""
        yield from self._scores
        for name, taker in self._takers.items():
            yield from self._scored(name, ask_each("video", name, taker.rest))

    def _scored(self, name: str, asked: Iterator[tuple[Any, float]]) -> Iterator[Score]:
        for taken, cpu_s in asked:
            self._cpu_s[name] += cpu_s
            if taken is None:
                return
            t_us, answer = taken
            log_image, failure = image_answer("video", name, answer, self._blank)
            sample = self._images.numbers[t_us]
            for variant, equalization in self._equalizations.items():
                truth = self._images.truth(sample, equalization)
                value = psnr_db(picture(log_image, truth.shape, equalization), truth)
                yield Score(
                    name,
                    value,
                    variant,
                    failure=failure,
                    sample=sample,
                    events=self._events[name],
                    cpu_s=self._cpu_s[name],
                    copied=variant != "",
                    t_us=t_us,
                )
            self._events[name], self._cpu_s[name] = 0, 0.0
