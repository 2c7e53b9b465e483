"""Dense optical flow on a recording: flow of all pixels, read at corners.

The references are those of `tasks.recording.flow`. Each window comes with the window before it,
which dense methods compare it with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import Events
from tasks.dense_flow import DenseFlowSample, flow_at
from tasks.errors import TaskError
from tasks.evaluation.scorers.answers import ask, flow_answer
from tasks.methods import load_method
from tasks.methods.contrast_maximization import EVEN_OFFSET_PX, Contrast
from tasks.recording.flow import Start, check, even_windows_us, event_corners, spread
from tasks.recording.frames import Frames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.pairs import inside
from tasks.recording.recording import Recording, cut
from tasks.recording.score import CONTRAST_GAIN, END_POINT_ERROR, RecordingScore
from tasks.recording.tracks import track


def score_dense_flow(
    recording: Recording,
    frames: Frames | None,
    methods: Sequence[str],
    weights: Mapping[str, str] | None = None,
    options: FlowOptions = USUAL_FLOW,
    on_progress: Progress = silent,
) -> list[RecordingScore]:
    """Score dense flow methods on a recording.

    Parameters
    ----------
    recording
        The events.
    frames
        Frames of the same camera, if there are some.
    methods
        Names, or "package.module:function".
    weights
        Files of weights by the names of the methods that need them.
    options
        Windows, and the patches around corners.
    on_progress
        Called after each window.

    Returns
    -------
    Scores of each window, corner and method, as of `tasks.recording.flow.score_flow`.

    Raises
    ------
    TaskError
        The recording is shorter than two windows, or nothing in it can be followed.
    """
    check(options)
    loaded = {name: load_method("dense_flow", name, weights) for name in methods}
    windows = list(_windows(recording, frames, options))
    starts_us = [2 * window.start_us - window.end_us for window in windows]
    starts_us = np.minimum.accumulate(starts_us[::-1])[::-1].tolist()  # cut needs ascending ones
    cuts = [(start, window.end_us) for start, window in zip(starts_us, windows, strict=True)]
    scores = []
    for done, (window, events) in enumerate(
        zip(windows, cut(recording.parts(), cuts), strict=True), start=1
    ):
        before = events.between(2 * window.start_us - window.end_us, window.start_us)
        during = events.between(window.start_us, window.end_us)
        if frames is None:
            reference: _Tracks | _Sharpness = _Sharpness(during, window, options)
        else:
            reference = _Tracks(frames, window, options)
        centers_px = reference.centers_px
        sample = DenseFlowSample(before, during, centers_px, np.zeros_like(centers_px))
        for name, method in loaded.items():
            answer, _ = ask("dense_flow", name, method, sample)
            estimate = flow_answer("dense_flow", name, answer, np.zeros(sample.shape))
            values = reference.values(flow_at(estimate.flow, centers_px))
            for item, value in enumerate(values):
                scores.append(
                    RecordingScore(
                        *(name, reference.metric, value, window.end_us, item), estimate.failure
                    )
                )
        on_progress("dense_flow", done, len(windows))
    if not scores:
        raise TaskError(
            f"{recording.path}: found nothing to follow in any window, expected corners"
        )
    return scores


@dataclass(frozen=True, slots=True)
class _Window:
    start_us: int
    end_us: int
    frame: int = 0  # number of the frame at its start, if there are frames


def _windows(
    recording: Recording, frames: Frames | None, options: FlowOptions
) -> Iterator[_Window]:
    """Yield the windows that have a window before them."""
    if frames is None:
        for start_us, end_us in even_windows_us(recording, options, first=1):
            yield _Window(start_us, end_us)
        return
    middle_us = frames.middle_us
    kept = [
        k
        for k in inside(recording, frames)
        if 2 * middle_us[k] - middle_us[k + 1] >= recording.start_us
    ]
    if not kept:
        raise TaskError(
            f"{recording.path}: found no frame with as many events before it as there are to the "
            "next one, expected one: dense flow compares two windows"
        )
    for k in spread(kept, options.windows):
        yield _Window(int(middle_us[k]), int(middle_us[k + 1]), k)


class _Tracks:
    """Tracks of corners from the frame at the start of a window to the next one."""

    metric = END_POINT_ERROR.name

    def __init__(self, frames: Frames, window: _Window, options: FlowOptions) -> None:
        k = window.frame
        found = track(frames.light(k), frames.light(k + 1), options.features)
        self.centers_px, self._flow_px = found.start_px, found.flow_px

    def values(self, flow_px: NDArray[np.float64]) -> list[float]:
        """Return the distance of each flow from the track, px."""
        distances: list[float] = np.linalg.norm(flow_px - self._flow_px, axis=1).tolist()
        return distances


class _Sharpness:
    """How much sharper the events around corners become along a flow."""

    metric = CONTRAST_GAIN.name

    def __init__(self, events: Events, window: _Window, options: FlowOptions) -> None:
        start = Start.of(options, 1.0, events.width)
        self._reach_px = start.reach_px
        self._contrasts, centers_px = [], []
        for center_px in event_corners(events)[: options.features]:
            unknown = np.full((events.height, events.width), np.nan)
            sample = start.sample(events, (window.start_us, window.end_us), unknown, center_px)
            if len(sample.t):
                contrast = Contrast(sample, self._reach_px, offset_px=EVEN_OFFSET_PX)
                self._contrasts.append((contrast, contrast(np.zeros(2))))
                centers_px.append(center_px)
        self.centers_px = np.array(centers_px).reshape(-1, 2)

    def values(self, flow_px: NDArray[np.float64]) -> list[float]:
        """Return the gain of each flow, 1 for zero flow."""
        return [
            contrast(np.clip(flow, -self._reach_px, self._reach_px)) / still
            for (contrast, still), flow in zip(self._contrasts, flow_px, strict=True)
        ]
