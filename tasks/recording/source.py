"""`RecordingWindow`: a window of a recording as a source for scorers, searched from zero."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from eres_render.progress import Progress
from sensor import Events
from tasks.errors import TaskError
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.settings import DenseFlow, Flow, TaskSettings, Video
from tasks.evaluation.source import Float64, FlowPoints, Images, Polarities, Source, Window
from tasks.recording.flow_windows import Sharpness, Start, Tracks, track, windows_of
from tasks.recording.frames import RecordedFrames, inside, sums
from tasks.recording.options import FlowOptions
from tasks.recording.recording import Recording, cut
from tasks.recording.threshold import Thresholds
from tasks.registry import TASKS
from tasks.video import picture


@dataclass(eq=False, kw_only=True)
class RecordingWindow(Source):
    """A window of a recording; `frame` is the index of the frame at its start.

    `stream` has the events of the window and, if the task needs them, the events before it.
    """

    search_from: Literal["truth", "zero"] = field(default="zero", init=False)
    recording: Recording
    frames: RecordedFrames | None
    thresholds: Thresholds
    options: FlowOptions
    window: Window
    stream: Iterable[Events]
    sample: int = 0
    frame: int = 0

    def __post_init__(self) -> None:
        self.name = str(self.recording.path)
        self.size, self.contrast_threshold = self.recording.size, self.thresholds.mean

    def log_image(self) -> Float64:
        if self.frames is None:
            return np.full(self.size[::-1], np.nan)
        return self.frames.log_light(self.frame)

    log_start = log_image

    def log_end(self) -> Float64:
        return self._frames.log_light(self.frame + 1)

    @property
    def _frames(self) -> RecordedFrames:
        assert self.frames is not None, "tasks that need frames are refused without"
        return self.frames

    def parts(self) -> Iterator[Events]:
        """Read the events."""
        return iter(self.stream)

    def changes(self) -> _WeightedEvents:
        return _WeightedEvents(self._frames, self.frame, self.thresholds)

    def points(self, task: Flow | DenseFlow) -> FlowPoints:
        reference: Tracks | Sharpness
        start = Start(self.options, self.size[0])
        if self.frames is not None:
            before, after = self.frames.light(self.frame), self.frames.light(self.frame + 1)
            reference = track(before, after, self.options.features)
        else:
            (events,) = self.stream
            during = events.between(self.window.start_us, self.window.end_us)
            reference = Sharpness(self.window, during, start)
        return FlowPoints(
            metric=reference.metric,
            centers_px=reference.centers_px,
            initial_px=np.zeros_like(reference.centers_px),
            sigma_px=start.sigma_px,
            sides={self.options.patch_px: [""]},
            value=reference.value,
            items=range(len(reference.centers_px)),
        )

    def images(self, task: Video) -> Images:
        frames, start_us, end_us = self._frames, self.window.start_us, self.window.end_us
        inside = [k for k, t_us in enumerate(frames.middle_us) if start_us < t_us <= end_us]
        if not inside:
            raise TaskError(f"{self.recording.path}: no frame is within the time of the events")
        times_us = frames.middle_us[inside]
        return Images(
            numbers={int(t_us): i for i, t_us in enumerate(times_us)},
            step_us=float(np.median(np.diff(times_us))) if len(inside) > 1 else None,
            truth=lambda i, name: picture(frames.log_light(inside[i]), self.size[::-1], name),
        )

    def log_white(self) -> float:
        return 0.0

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


class _WeightedEvents(Polarities):
    """Sums of the events from a frame to the next one, weighted by their exposures."""

    def __init__(self, frames: RecordedFrames, k: int, thresholds: Thresholds) -> None:
        self._frames, self._k, self._thresholds = frames, k, thresholds
        self._change = np.zeros(())

    def push(self, events: Events) -> None:
        self._change = self._change + self._thresholds.change(sums(events, self._frames, self._k))

    def total(self) -> Float64:
        return np.asarray(self._change / self._thresholds.mean)


def sources(
    recording: Recording,
    task: str,
    settings: TaskSettings,
    frames: RecordedFrames | None,
    thresholds: Thresholds,
    options: FlowOptions,
    on_progress: Progress,
) -> Iterator[RecordingWindow]:
    """Yield the windows that a task scores; only one window has its events in memory.

    Tasks on continuous stretches get the whole recording, tasks that need frames every pair of
    frames, and others the windows of the options.
    """
    part_of = partial(
        RecordingWindow, recording=recording, frames=frames, thresholds=thresholds, options=options
    )
    if any(each.continuous_s for each in settings.plan()):
        whole = Window(recording.start_us, recording.end_us)
        yield part_of(window=whole, stream=recording.counted(task, on_progress))
        return
    with_before = any(each.windows_before for each in settings.plan())
    if frames is not None and "frames" in TASKS[task].needs:
        ends = frames.start_us.tolist(), frames.end_us.tolist()
        windows = [(Window(ends[0][k], ends[1][k + 1]), k) for k in inside(recording, frames)]
    else:
        windows = windows_of(recording, frames, options, with_before=with_before)
    starts_us = [w.before_us if with_before else w.start_us for w, _ in windows]
    starts_us = np.minimum.accumulate(starts_us[::-1])[::-1].tolist()  # cut needs ascending starts
    cuts = [(start_us, w.end_us) for start_us, (w, _) in zip(starts_us, windows, strict=True)]
    for i, events in enumerate(cut(recording.parts(), cuts)):
        window, frame = windows[i]
        yield part_of(window=window, stream=[events], sample=i, frame=frame)
        on_progress(task, i + 1, len(windows))
