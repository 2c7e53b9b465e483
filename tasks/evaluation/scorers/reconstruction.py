"""Image reconstruction: the image at the window's end, from its start and its events."""

from __future__ import annotations

from collections.abc import Iterator

from sensor import Events
from tasks.evaluation.answers import ask, image_answer
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import Reconstruction
from tasks.evaluation.source import Source
from tasks.methods import load_method
from tasks.reconstruction import ReconstructionSample, psnr_db


class ReconstructionScorer:
    """Scores the PSNR of the image at the window's end."""

    def __init__(self, source: Source, task: Reconstruction) -> None:
        self._source, self._task = source, task
        self._changes = source.changes()
        self._events = 0

    def push(self, events: Events) -> None:
        """Add up the window's polarities."""
        window = self._source.window
        self._changes.push(events)
        self._events += len(events.between(window.start_us, window.end_us))

    def scores(self) -> Iterator[Score]:
        """Yield one score for each method."""
        source = self._source
        log_start, log_end = source.log_start(), source.log_end()
        sample = ReconstructionSample(log_start, self._changes.total(), source.contrast_threshold)
        for name in self._task.methods:
            options = {"upsampling": self._task.upsampling} if name == "event_integration" else {}
            method = load_method("reconstruction", name)
            answer, cpu_s = ask("reconstruction", name, method, sample, **options)
            prediction, failure = image_answer("reconstruction", name, answer, log_start)
            value = psnr_db(prediction, log_end, source.log_white())
            yield Score(name, value, failure=failure, events=self._events, cpu_s=cpu_s)
