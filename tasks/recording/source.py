"""`RecordingWindow`: a window of a recording as a source for scorers, searched from zero."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress
from sensor import Events
from tasks.errors import TaskError
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import DenseFlow, Flow, TaskSettings, Video
from tasks.evaluation.source import FlowPoints, Images, Source, Window
from tasks.recording.flow_windows import Sharpness, Start, Tracks, windows_of
from tasks.recording.frames import Frames
from tasks.recording.options import FlowOptions
from tasks.recording.pairs import PairSums, inside, sums
from tasks.recording.recording import Recording, cut
from tasks.recording.threshold import Thresholds
from tasks.registry import TASKS
from tasks.video import picture

Float64 = NDArray[np.float64]


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingWindow(Source):
    """A window of a recording.

    Parameters
    ----------
    sample
        Number of the window.
    frame
        Index of the frame at its start.
    events
        Events of the window and, if the task needs them, before it; None for all of the recording.
    """

    search_from: Literal["truth", "zero"] = "zero"
    recording: Recording
    frames: Frames | None
    thresholds: Thresholds
    options: FlowOptions
    window: Window
    sample: int = 0
    frame: int = 0
    events: Events | None = None

    @property
    def size(self) -> tuple[int, int]:
        return self.recording.size

    @property
    def contrast_threshold(self) -> float:
        return self.thresholds.mean

    @cached_property
    def log_image(self) -> Float64:
        if self.frames is None:
            return np.full(self.size[::-1], np.nan)
        return self.frames.log_light(self.frame)

    @property
    def log_end(self) -> Float64:
        return self._frames.log_light(self.frame + 1)

    @property
    def _frames(self) -> Frames:
        assert self.frames is not None, "tasks that need frames are refused without"
        return self.frames

    def parts(self) -> Iterator[Events]:
        """Read the events."""
        return self.recording.parts() if self.events is None else iter([self.events])

    def changes(self) -> _WeightedEvents:
        return _WeightedEvents(self._frames, self.frame, self.thresholds)

    def points(self, task: Flow | DenseFlow) -> FlowPoints:
        start, features = Start.of(self.options, self.size[0]), self.options.features
        reference: Tracks | Sharpness
        if self.frames is not None:
            reference = Tracks(self.frames, self.frame, features)
        else:
            assert self.events is not None, "flow has windows"
            during = self.events.between(self.window.start_us, self.window.end_us)
            reference = Sharpness(self.window, during, start, features)
        return FlowPoints(
            metric=reference.metric,
            centers_px=reference.centers_px,
            initial_px=np.zeros_like(reference.centers_px),
            sigma_px=start.sigma_px,
            sides={start.patch_px: [""]},
            value=reference.value,
            items=range(len(reference.centers_px)),
        )

    def images(self, task: Video) -> Images:
        frames, start_us, end_us = self._frames, self.window.start_us, self.window.end_us
        kept = [k for k, t_us in enumerate(frames.middle_us) if start_us < t_us <= end_us]
        if not kept:
            raise TaskError(f"{self.recording.path}: found no frame within the time of the events")
        times_us = frames.middle_us[kept]
        return Images(
            numbers={int(t_us): i for i, t_us in enumerate(times_us)},
            step_us=float(np.median(np.diff(times_us))) if len(kept) > 1 else None,
            truth=lambda i, name: picture(frames.log_light(kept[i]), self.size[::-1], name),
        )

    def columns(self, score: Score) -> dict[str, Any]:
        model = self.recording.header.model
        frames, end_us = self.frames, self.window.end_us
        t_us = end_us if frames is None else int(frames.middle_us[self.frame + 1])
        return {
            "scene": self.recording.path.name,
            "cutoff_hz": math.inf if model is None else model.cutoff_hz,
            "speed": 1.0,
            "sample": self.sample if score.sample is None else score.sample,
            "t_us": score.t_us or t_us,
        }


class _WeightedEvents:
    """Sums of the events from a frame to the next one, weighted by their exposures."""

    def __init__(self, frames: Frames, k: int, thresholds: Thresholds) -> None:
        self._frames, self._k, self._thresholds = frames, k, thresholds
        self._sums = PairSums(np.zeros(()), np.zeros(()))

    def push(self, events: Events) -> None:
        found = sums(events, self._frames, self._k)
        self._sums = PairSums(self._sums.on + found.on, self._sums.off + found.off)

    def total(self) -> Float64:
        return self._thresholds.change(self._sums) / self._thresholds.mean


def sources(
    recording: Recording,
    task: str,
    settings: TaskSettings,
    frames: Frames | None,
    thresholds: Thresholds,
    options: FlowOptions,
    on_progress: Progress,
) -> Iterator[RecordingWindow]:
    """Yield the windows that a task scores; one at a time has its events in memory.

    A task on continuous stretches has all of the recording, one that needs frames every pair of
    them, and others the windows of the options.
    """
    common: dict[str, Any] = {
        **{"recording": recording, "frames": frames, "thresholds": thresholds, "options": options}
    }
    if any(one.continuous_s for one in settings.plan()):
        yield RecordingWindow(**common, window=Window(recording.start_us, recording.end_us))
        return
    with_before = any(one.windows_before for one in settings.plan())
    if frames is not None and "frames" in TASKS[task].needs:
        ends = frames.start_us.tolist(), frames.end_us.tolist()
        windows = [(Window(ends[0][k], ends[1][k + 1]), k) for k in inside(recording, frames)]
    else:
        windows = windows_of(recording, frames, options, with_before=with_before)
    starts_us = [one.before_us if with_before else one.start_us for one, _ in windows]
    starts_us = np.minimum.accumulate(starts_us[::-1])[::-1].tolist()  # cut needs ascending starts
    cuts = [(start_us, one.end_us) for start_us, (one, _) in zip(starts_us, windows, strict=True)]
    for i, events in enumerate(cut(recording.parts(), cuts)):
        window, frame = windows[i]
        yield RecordingWindow(**common, window=window, sample=i, frame=frame, events=events)
        on_progress(task, i + 1, len(windows))
