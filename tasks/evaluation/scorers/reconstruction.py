"""Image reconstruction: the image at the window's end, from its start and its events."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sensor import Events
from tasks.evaluation.answers import ask, image_answer
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import Reconstruction
from tasks.methods import load_method
from tasks.reconstruction import ReconstructionSample, psnr_db


class ReconstructionScorer:
    """Scores the PSNR of the image at the window's end."""

    def __init__(self, reference: ReferenceFrames, setting: Setting, task: Reconstruction) -> None:
        self._reference, self._setting, self._task = reference, setting, task
        model = setting.model
        self._off_weight = model.off_threshold / model.contrast_threshold
        size = model.height, model.width
        self._sum = np.zeros(size, np.int64)
        # Sum of OFF events; a single 0 if they count like ON events.
        self._off_sum = np.zeros((1, 1) if self._off_weight == 1 else size, np.int64)
        self._events = 0

    def push(self, events: Events) -> None:
        """Add up the window's polarities."""
        window = events.between(self._setting.start_us, self._setting.end_us)
        if len(window):
            self._sum += window.polarity_sum()
            if self._off_weight != 1:
                self._off_sum += window.where(window.p < 0).polarity_sum()
            self._events += len(window)

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method."""
        reference, model = self._reference, self._setting.model
        log_start, log_end = reference.log_start(model), reference.log_end(model)
        sample = ReconstructionSample(
            log_start,
            self._sum + (self._off_weight - 1) * self._off_sum,
            model.contrast_threshold,
        )
        for name in self._task.methods:
            options = {"upsampling": self._task.upsampling} if name == "event_integration" else {}
            method = load_method("reconstruction", name)
            answer, cpu_s = ask("reconstruction", name, method, sample, **options)
            prediction, failure = image_answer("reconstruction", name, answer, log_start)
            value = psnr_db(prediction, log_end, reference.log_white(model))
            yield Score(name, value, failure=failure, events=self._events, cpu_s=cpu_s)
