"""Dense optical flow on a recording: flow of all pixels, read at corners.

Dense methods get each window and the window before it. `tasks.recording.flow_windows` describes the
windows and the reference for flow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from eres_render.progress import Progress, silent
from tasks.dense_flow import DenseFlowSample, flow_at
from tasks.evaluation.answers import ask, flow_answer
from tasks.methods import load_method
from tasks.recording.flow_windows import Start, followed
from tasks.recording.frames import Frames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.recording import Recording
from tasks.recording.score import RecordingScore


def score_dense_flow(
    recording: Recording,
    frames: Frames | None,
    methods: Sequence[str],
    weights: Mapping[str, str] | None = None,
    options: FlowOptions = USUAL_FLOW,
    on_progress: Progress = silent,
) -> list[RecordingScore]:
    """Score dense flow methods on a recording."""
    loaded = {name: load_method("dense_flow", name, weights) for name in methods}
    start = Start.of(options, np.nan, recording.size[0])
    scores = []
    for window, events, reference in followed(
        *(recording, frames, start, options), partial(on_progress, "dense_flow"), with_before=True
    ):
        before = events.between(window.before_us, window.start_us)
        during = events.between(window.start_us, window.end_us)
        centers_px = reference.centers_px
        sample = DenseFlowSample(before, during, centers_px, np.zeros_like(centers_px))
        for name, method in loaded.items():
            answer, _ = ask("dense_flow", name, method, sample)
            found = flow_answer("dense_flow", name, answer, np.zeros(sample.shape))
            for item, flow_px in enumerate(flow_at(found.flow, centers_px)):
                value = reference.value(item, flow_px)
                scores.append(
                    RecordingScore(
                        *(name, reference.metric, value, window.end_us, item, found.failure)
                    )
                )
    return scores
