"""Optical flow on a recording, from zero: no motion is known before.

With frames, a window lasts from one frame to the next, patches are around corners of the first, and
the reference is where those are in the second. Without frames there is no reference: the score is
how much sharper the image of the events becomes when they are moved back along the flow, the flow
warp loss of Stoffregen et al., "Reducing the Sim-to-Real Gap for Event Cameras" (ECCV 2020), for
each patch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor import Events
from tasks.errors import TaskError
from tasks.evaluation.scorers.answers import ask, flow_answer
from tasks.flow import FlowEstimate, FlowSample, flow_sample
from tasks.methods import load_method
from tasks.methods.contrast_maximization import EVEN_OFFSET_PX, Contrast, estimate
from tasks.recording.frames import Frames
from tasks.recording.options import USUAL_FLOW, FlowOptions
from tasks.recording.pairs import events_of, inside
from tasks.recording.recording import Recording, cut
from tasks.recording.score import CONTRAST_GAIN, END_POINT_ERROR, RecordingScore
from tasks.recording.tracks import strong_corners, track

_SIGMAS = 4  # that a search goes from its start, in every method
LOCAL = (
    *("photometric_flow", "photometric_flow_unknown_contrast", "photometric_flow_by_descent"),
    "photometric_flow_with_delay",
)
"""Methods whose search ends at the nearest minimum: they start from contrast maximization."""


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
        Frames of the same camera, if there are some.
    methods
        Names, or "package.module:function".
    contrast_threshold
        For methods that use it, log units.
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
        The recording is shorter than a window, or nothing in it can be followed.
    """
    check(options)
    loaded = {name: load_method("flow", name) for name in methods}
    start = Start.of(options, contrast_threshold, recording.size[0])
    scored = (
        _with_frames(recording, frames, loaded, start, options, on_progress)
        if frames is not None
        else _alone(recording, loaded, start, options, on_progress)
    )
    found = list(scored)
    if not found:
        raise TaskError(
            f"{recording.path}: found nothing to follow in any window, expected corners"
        )
    return found


def check(options: FlowOptions) -> None:
    """Refuse windows, features or patches of no size."""
    for name, least in (("window_ms", 1e-3), ("windows", 1), ("features", 1), ("patch_px", 3)):
        value = getattr(options, name)
        if not value >= least:
            said = name.replace("_", "-")
            raise TaskError(f"{said}: found {value:g}, expected at least {least:g}")
    if options.search_px is not None:
        check_positive("search-px", options.search_px, TaskError)


@dataclass(frozen=True, slots=True)
class Start:
    """What all samples of a recording have in common.

    Parameters
    ----------
    contrast_threshold
        Log units.
    patch_px
        Side of a patch, px.
    sigma_px
        Scale of the flow, from zero, px.
    """

    contrast_threshold: float
    patch_px: int
    sigma_px: float

    @classmethod
    def of(cls, options: FlowOptions, contrast_threshold: float, width: int) -> Start:
        """Return it for a sensor.

        Parameters
        ----------
        options
            Windows and patches.
        contrast_threshold
            Log units.
        width
            Width of the sensor, px.

        Returns
        -------
        Start
        """
        reach_px = options.search_px or width / 16
        return cls(contrast_threshold, options.patch_px, reach_px / _SIGMAS)

    @property
    def reach_px(self) -> float:
        """Largest flow along each axis, px."""
        return _SIGMAS * self.sigma_px

    def sample(
        self, events: Events, window_us: tuple[int, int], log_image: NDArray, center_px: NDArray
    ) -> FlowSample:
        """Return the patch around a corner.

        Parameters
        ----------
        events
            Events of the window, and any others.
        window_us
            Start and end of the window.
        log_image
            (H, W) log light at its start, or NaN.
        center_px
            The corner.

        Returns
        -------
        FlowSample
        """
        return flow_sample(
            events,
            *window_us,
            log_image=log_image,
            contrast_threshold=self.contrast_threshold,
            center_px=center_px,
            side_px=self.patch_px,
            initial=np.zeros(2),
            initial_sigma_px=self.sigma_px,
        )


def spread(numbers: Sequence[int], most: int) -> list[int]:
    """Return at most so many of some numbers, spread evenly.

    Parameters
    ----------
    numbers, most
        The numbers, and how many to return at most.

    Returns
    -------
    list of int

    Examples
    --------
    >>> from tasks.recording.flow import spread
    >>> spread(range(10), 4)
    [1, 3, 6, 8]
    """
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[int((k + 0.5) * len(numbers) / most)] for k in range(most)]


def _with_frames(
    recording: Recording,
    frames: Frames,
    methods: Mapping[str, Callable[..., Any]],
    start: Start,
    options: FlowOptions,
    on_progress: Progress,
) -> Iterator[RecordingScore]:
    pairs = spread(inside(recording, frames), options.windows)
    middle_us = frames.middle_us
    for done, (k, events) in enumerate(
        zip(pairs, events_of(recording, frames, pairs), strict=True), start=1
    ):
        window_us = int(middle_us[k]), int(middle_us[k + 1])
        tracks = track(frames.light(k), frames.light(k + 1), options.features)
        log_image = frames.log_light(k)
        for item, (center_px, truth_px) in enumerate(
            zip(tracks.start_px, tracks.flow_px, strict=True)
        ):
            sample = start.sample(events, window_us, log_image, center_px)
            for name, found in _answers(methods, sample):
                error_px = float(np.linalg.norm(found.flow - truth_px))
                yield RecordingScore(
                    *(name, END_POINT_ERROR.name, error_px, window_us[1], item, found.failure)
                )
        on_progress("flow", done, len(pairs))


def _answers(
    methods: Mapping[str, Callable[..., Any]], sample: FlowSample
) -> Iterator[tuple[str, FlowEstimate]]:
    """Yield the flow that each method finds."""
    nearby = sample
    if any(name in LOCAL for name in methods):
        nearby = replace(sample, initial=estimate(sample).flow)
    for name, method in methods.items():
        given = nearby if name in LOCAL else sample
        answer, _ = ask("flow", name, method, given)
        yield name, flow_answer("flow", name, answer, given.initial)


def _alone(
    recording: Recording,
    methods: Mapping[str, Callable[..., Any]],
    start: Start,
    options: FlowOptions,
    on_progress: Progress,
) -> Iterator[RecordingScore]:
    windows_us = even_windows_us(recording, options)
    width, height = recording.size
    unknown = np.full((height, width), np.nan)
    for done, (window_us, events) in enumerate(
        zip(windows_us, cut(recording.parts(), windows_us), strict=True), start=1
    ):
        for item, center_px in enumerate(event_corners(events)[: options.features]):
            sample = start.sample(events, window_us, unknown, center_px)
            if not len(sample.t):
                continue
            reach = start.reach_px
            contrast = Contrast(sample, reach, offset_px=EVEN_OFFSET_PX)
            still = contrast(np.zeros(2))
            for name, found in _answers(methods, sample):
                gain = contrast(np.clip(found.flow, -reach, reach)) / still
                yield RecordingScore(
                    *(name, CONTRAST_GAIN.name, gain, window_us[1], item, found.failure)
                )
        on_progress("flow", done, len(windows_us))


def even_windows_us(
    recording: Recording, options: FlowOptions, first: int = 0
) -> list[tuple[int, int]]:
    """Return windows of even length, spread over a recording.

    Parameters
    ----------
    recording
        The events.
    options
        Length and largest number of the windows.
    first
        Windows at the start of the recording to leave out.

    Returns
    -------
    list of (int, int)
        Start and end of each, microseconds.

    Raises
    ------
    TaskError
        The recording is too short.
    """
    length_us = round(1e3 * options.window_ms)
    whole = (recording.end_us - recording.start_us) // length_us
    if whole <= first:
        long_ms = (recording.end_us - recording.start_us) / 1000
        least = "a window" if first == 0 else f"{first + 1} windows"
        raise TaskError(
            f"{recording.path}: found {long_ms:g} ms of events, expected at least {least} of "
            f"{options.window_ms:g} ms (--window-ms)"
        )
    numbers = spread(range(first, whole), options.windows)
    begins_us = [recording.start_us + n * length_us for n in numbers]
    return [(begin, begin + length_us) for begin in begins_us]


def event_corners(events: Events) -> NDArray[np.float64]:
    """Return the corners of the image of events, the strongest first.

    Parameters
    ----------
    events
        Events of one window.

    Returns
    -------
    (N, 2) positions, px.
    """
    size = events.width * events.height
    pixel = events.y.astype(np.int64) * events.width + events.x
    image = np.bincount(pixel, minlength=size).reshape(events.height, events.width)
    smooth = cv2.GaussianBlur(np.sqrt(image).astype(np.float32), (0, 0), 1.0)
    return strong_corners(np.asarray(smooth, np.float32))
