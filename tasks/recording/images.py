"""Images on a recording with frames: each is compared with the frame that the camera took.

`reconstruction` predicts a frame from the one before it and the events between them; its baseline
is the frame before. `video` uses only events; as these do not determine the level of the light,
histograms are equalized before the comparison, and the baseline is a gray image.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from eres_render.progress import Progress, silent
from tasks.errors import TaskError
from tasks.evaluation.answers import ask, ask_each, image_answer
from tasks.methods import load_method
from tasks.methods.e2vid import even_window_us
from tasks.psnr import psnr_db as picture_psnr_db
from tasks.reconstruction import ReconstructionSample, psnr_db
from tasks.recording.frames import Frames
from tasks.recording.pairs import events_of, inside, sums
from tasks.recording.recording import Recording
from tasks.recording.score import PSNR, RecordingScore
from tasks.recording.threshold import Thresholds
from tasks.registry import TASKS
from tasks.video import ImageTaker, picture


def network_options(name: str, times_us: Sequence[int]) -> dict[str, float]:
    """Return the further arguments of a method of `video`.

    Parameters
    ----------
    name
        Name of the method.
    times_us
        Times of the images, us, ascending.

    Returns
    -------
    For a network, windows of which a whole number fits into the median time between images.
    """
    if name not in TASKS["video"].networks or len(times_us) < 2:
        return {}
    return {"window_us": even_window_us(float(np.median(np.diff(times_us))))}


def score_reconstruction(
    recording: Recording,
    frames: Frames,
    methods: Sequence[str],
    thresholds: Thresholds,
    on_progress: Progress = silent,
) -> list[RecordingScore]:
    """Score predictions of each frame from the one before it.

    Parameters
    ----------
    recording, frames
        The events and frames.
    methods
        Names, or "package.module:function".
    thresholds
        Contrast thresholds. Methods get one for both polarities, and polarity sums that account for
        the difference.
    on_progress
        Called after each pair of frames.

    Returns
    -------
    PSNR of each frame and method, of linear light; the peak is white, the largest value that the
    files can store, for floats `Frames.white_level`.
    """
    pairs = inside(recording, frames)
    loaded = {name: load_method("reconstruction", name) for name in methods}
    scores = []
    for done, (k, events) in enumerate(
        zip(pairs, events_of(recording, frames, pairs), strict=True), start=1
    ):
        before, after = frames.log_light(k), frames.log_light(k + 1)
        change = thresholds.change(sums(events, frames, k))
        sample = ReconstructionSample(before, change / thresholds.mean, thresholds.mean)
        for name, method in loaded.items():
            answer, _ = ask("reconstruction", name, method, sample)
            prediction, failure = image_answer("reconstruction", name, answer, before)
            value = psnr_db(prediction, after, log_white=0.0)
            t_us = int(frames.middle_us[k + 1])
            scores.append(RecordingScore(name, PSNR, value, t_us, failure=failure))
        on_progress("reconstruction", done, len(pairs))
    return scores


def score_video(
    recording: Recording,
    frames: Frames,
    methods: Sequence[str],
    contrast_threshold: float,
    weights: Mapping[str, str] | None = None,
    on_progress: Progress = silent,
) -> list[RecordingScore]:
    """Score images from events alone at the time of each frame.

    Parameters
    ----------
    recording, frames
        The events and frames.
    methods
        Names, or "package.module:class".
    contrast_threshold
        C for both polarities, log units.
    weights
        Files of weights by the names of the methods that need them.
    on_progress
        Called after each part of the events.

    Returns
    -------
    PSNR of each image and method, of equalized pictures.

    Raises
    ------
    TaskError
        No frame is within the time of the events.
    """
    kept = [
        k
        for k, t_us in enumerate(frames.middle_us)
        if recording.start_us < t_us <= recording.end_us
    ]
    if not kept:
        raise TaskError(f"{recording.path}: found no frame within the time of the events")
    numbers = {int(frames.middle_us[k]): k for k in kept}
    width, height = recording.size
    arguments = width, height, contrast_threshold
    takers = {}
    for name in methods:
        start, options = load_method("video", name, weights), network_options(name, [*numbers])
        takers[name] = ImageTaker(ask("video", name, start, *arguments, **options)[0], numbers)
    blank = np.zeros((height, width))
    scores = []

    def score(name: str, asked: Iterator[tuple[Any, float]]) -> None:
        for taken, _ in asked:
            if taken is None:
                return
            t_us, answer = taken
            log_image, failure = image_answer("video", name, answer, blank)
            truth = picture(frames.log_light(numbers[t_us]), (height, width))
            found = picture(log_image, (height, width))
            value = picture_psnr_db(found, truth)
            scores.append(RecordingScore(name, PSNR, value, t_us, failure=failure))

    seen = 0
    for events in recording.parts():
        for name, taker in takers.items():
            score(name, ask_each("video", name, taker.take, events))
        seen += len(events)
        on_progress("video", seen, recording.count)
    for name, taker in takers.items():
        score(name, ask_each("video", name, taker.rest))
    return sorted(scores, key=lambda one: (one.t_us, list(methods).index(one.method)))
