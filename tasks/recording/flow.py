"""Optical flow on a recording, from zero, as no initial flow is known.

`tasks.recording.flow_windows` describes the windows and the reference for flow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from eres_render.progress import Progress, silent
from tasks.evaluation.answers import ask, flow_answer
from tasks.flow import FlowEstimate, FlowSample
from tasks.methods import load_method
from tasks.methods.contrast_maximization import determined, estimate, off_grid
from tasks.recording.flow_windows import Start, followed
from tasks.recording.frames import Frames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.recording import Recording
from tasks.recording.score import RecordingScore
from tasks.registry import TASKS

_BY_CONTRAST = "tasks.methods.contrast_maximization:"


def score_flow(
    recording: Recording,
    frames: Frames | None,
    methods: Sequence[str],
    contrast_threshold: float,
    options: FlowOptions = USUAL_FLOW,
    on_progress: Progress = silent,
) -> list[RecordingScore]:
    """Score flow methods on a recording.

    Parameters
    ----------
    recording
        The events.
    frames
        Frames of the same camera, if there are any.
    methods
        Names, or "package.module:function".
    contrast_threshold
        C for methods that use it, log units.
    options
        Windows and patches.
    on_progress
        Called after each window.

    Returns
    -------
    Scores of each window, patch and method: without frames the contrast gain, 1 for zero flow; with
    frames the distance from the tracks of the corners, px of the sensor.

    Raises
    ------
    TaskError
        The recording is shorter than a window, or has no corners to follow.
    """
    loaded = {name: load_method("flow", name) for name in methods}
    for name in methods:
        if TASKS["flow"].method(name).place.startswith(_BY_CONTRAST):
            loaded[name] = partial(determined, loaded[name])
    width, height = recording.size
    start = Start.of(options, contrast_threshold, width)
    log_image = np.full((height, width), np.nan)
    scores = []
    for window, events, reference in followed(
        *(recording, frames, start, options), partial(on_progress, "flow")
    ):
        if frames is not None:
            log_image = frames.log_light(window.frame)
        for item, center_px in enumerate(reference.centers_px):
            sample = start.sample(events, window, log_image, center_px)
            for name, found in _answers(loaded, sample):
                value = reference.value(item, found.flow)
                scores.append(
                    RecordingScore(
                        *(name, reference.metric, value, window.end_us, item, found.failure)
                    )
                )
    return scores


def _answers(
    methods: Mapping[str, Callable[..., Any]], sample: FlowSample
) -> Iterator[tuple[str, FlowEstimate]]:
    """Yield the flow that each method finds."""
    local = [name for name in methods if "guess" in TASKS["flow"].method(name).needs]
    nearby = replace(sample, initial=estimate(off_grid(sample)).flow) if local else sample
    for name, method in methods.items():
        given = nearby if name in local else sample
        answer, _ = ask("flow", name, method, given)
        yield name, flow_answer("flow", name, answer, given.initial)
