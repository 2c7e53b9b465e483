"""Video: images at regular times along a continuous stretch, from events alone."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from sensor import Events
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.answers import blamed, image_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.methods import load_method
from tasks.video import ImageTaker, picture, psnr_db


class VideoScorer:
    """PSNR of each image, which is a sample of its own."""

    def __init__(self, light: ReferenceFrames, setting: Setting) -> None:
        self._light = light
        self._config = light.evaluate.video
        model = setting.model
        self._samples = {round(t_s / setting.speed * 1e6): t_s for t_s in light.video_times_s}
        self._takers = {}
        for name in self._config.methods:
            start = load_method("video", name)
            with blamed("video", name):
                method = start(model.width, model.height, model.contrast_threshold)
            self._takers[name] = ImageTaker(method, self._samples)
        self._blank = np.zeros((model.height, model.width))
        self._scores: list[Score] = []
        # Of each method since its last image.
        self._events = dict.fromkeys(self._takers, 0)
        self._cpu_s = dict.fromkeys(self._takers, 0.0)

    def push(self, events: Events) -> None:
        """Pass the events on, and score the images that are due: they are too large to keep."""
        for name, taker in self._takers.items():
            started_s = time.thread_time()
            with blamed("video", name):
                taken = taker.push(events)
            self._cpu_s[name] += time.thread_time() - started_s
            self._events[name] += len(events)
            self._score(name, taken)

    def scores(self) -> Iterator[Score]:
        """One score an image and method."""
        for name, taker in self._takers.items():
            with blamed("video", name):
                taken = taker.finish()
            self._score(name, taken)
        yield from self._scores

    def _score(self, name: str, taken: list) -> None:
        for t_us, answer in taken:
            log_image, failure = image_answer("video", name, answer, self._blank)
            t_s = self._samples[t_us]
            truth = self._light.video_picture(t_s)
            found = picture(log_image, truth.shape, self._config.equalization)
            sample = self._light.video_times_s.index(t_s)
            value = psnr_db(found, truth)
            self._scores.append(
                Score(
                    "video",
                    name,
                    "psnr_db",
                    value,
                    failure=failure,
                    sample=sample,
                    events=self._events[name],
                    cpu_s=self._cpu_s[name],
                )
            )
            self._events[name], self._cpu_s[name] = 0, 0.0
