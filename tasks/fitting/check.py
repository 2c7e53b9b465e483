"""Compare a fitted camera with events that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import EventCamera, Events
from sensor.events import concatenate
from tasks.errors import TaskError
from tasks.footage import Footage
from tasks.recording.frames import RecordedFrames
from tasks.recording.levels import SETTLING, busiest, every_second, light_between
from tasks.recording.motion import INTERPOLATED, KNOWN

BLOCKS = 4
"""Blocks of the image along each axis."""


Check = Literal["second", "first", "none"]
"""The half that is held out."""

_LEAST = 5  # frames: three of each half, the middle one in both


class Part(NamedTuple):
    """Light of one half of a recording, or of all of it.

    Parameters
    ----------
    light
        The light, at times between which the image moves by half a pixel at most.
    coarse
        The same from every second frame.
    counted_us
        (2,) start and end of the time in which events are counted, microseconds. Before it the
        memories of simulated pixels settle.
    exposure_us
        Longest exposure of the frames.
    errors
        Share of a filter that errors of the light may explain, for `fit_motion`.
    """

    light: Footage
    coarse: Footage
    counted_us: tuple[int, int]
    exposure_us: float
    errors: float

    def played(self, stage: str, on_progress: Progress) -> Iterator[NDArray[np.float32]]:
        """Yield the frames of the light, and report progress at each.

        Parameters
        ----------
        stage
            What the light is needed for, as `on_progress` gets it.
        on_progress
            Called with the number of frames so far, and of all.

        Yields
        ------
        (H, W) frames.
        """
        for k, frame in enumerate(self.light, start=1):
            on_progress(stage, k, len(self.light))
            yield frame

    def counted(self, simulated: Events) -> Events:
        """Return the events that count, of a simulated sensor on the clock `t_s` of the light."""
        return simulated.between(*(t_us - self.light.t_offset_us for t_us in self.counted_us))


def parts_of(
    events: Events, light: RecordedFrames | Footage, check: Check
) -> tuple[Part, Part | None]:
    """Divide what a camera saw in time.

    Parameters
    ----------
    events
        The recording.
    light
        Frames of the same camera, on the clock of the events; or light, as in `Part`.
    check
        The half that is held out.

    Returns
    -------
    The part to fit, and the held-out half, None for "none". A held-out second half begins one frame
    before the middle, so that its pixels have settled there.

    Raises
    ------
    TaskError
        There are too few frames within the time of the events.
    """
    if isinstance(light, RecordedFrames):
        light = busiest([events], light)
    last = len(light) - 1
    if check == "none":
        return _part(light, 0, last), None
    if last + 1 < _LEAST:
        frames = f"--check: found {last + 1} frames within the time of the events"
        raise TaskError(f"{frames}, expected at least {_LEAST}; --check none skips the check")
    middle = last // 2
    if check == "first":
        return _part(light, middle, last), _part(light, 0, middle)
    return _part(light, 0, middle), _part(light, middle - 1, last)


def _part(whole: RecordedFrames | Footage, start: int, end: int) -> Part:
    """Return the light from one frame to another."""
    exposure_us, errors = 0.0, KNOWN
    if isinstance(whole, RecordedFrames):
        frames = whole.some(np.arange(start, end + 1))
        light, coarse = light_between(frames), light_between(frames.every_second())
        exposure_us = float(np.max(frames.end_us - frames.start_us))
        second_us, errors = float(frames.middle_us[1]), INTERPOLATED
    else:
        t_s = whole.t_s[start : end + 1]
        light = replace(whole, t_s=t_s, frames=lambda: islice(whole, start, end + 1))
        coarse = every_second(light)
        second_us = 0.0
    first_us, last_us = (light.t_offset_us + 1e6 * light.t_s[[0, -1]]).tolist()
    settled_us = max(second_us, first_us + SETTLING * (last_us - first_us))
    return Part(light, coarse, (round(settled_us), round(last_us)), exposure_us, errors)


class Agreement(NamedTuple):
    """Real events of a part of a recording, and those of a camera simulated in its light.

    Parameters
    ----------
    counted_us
        (2,) start and end of the time in which events are counted, microseconds.
    real, simulated
        (2,) numbers of ON and of OFF events.
    quartiles
        (3,) quartiles of simulated / real events over 4 x 4 blocks of the image with real events.
    real_us, simulated_us
        Medians of the time between successive events of a pixel, microseconds; NaN without any.
    """

    counted_us: tuple[int, int]
    real: tuple[int, int]
    simulated: tuple[int, int]
    quartiles: tuple[float, float, float]
    real_us: float
    simulated_us: float


def compare(
    events: Events, part: Part, camera: EventCamera, on_progress: Progress = silent
) -> Agreement:
    """Simulate a camera in the light of a part of a recording, and compare the events.

    Parameters
    ----------
    events, part
        The recording, and the light of the part.
    camera
        The camera, with the grid of the recording.
    on_progress
        Called after each frame of the light.

    Returns
    -------
    Agreement

    Raises
    ------
    TaskError
        There are no real events in the part.
    """
    start_us, end_us = part.counted_us
    real = events.between(start_us, end_us)
    if not len(real):
        raise TaskError(f"--check: the held-out half, {start_us} to {end_us} us, has no events")
    stream = camera.stream(part.played("checking", on_progress), part.light.t_s, white=1.0)
    simulated = concatenate(list(map(part.counted, stream)))
    in_real, in_simulated = _in_blocks(real), _in_blocks(simulated)
    fired = in_real > 0
    quartiles = np.percentile(in_simulated[fired] / in_real[fired], (25, 50, 75)).tolist()
    signs = _signs(real), _signs(simulated)
    intervals_us = _interval_us(real), _interval_us(simulated)
    return Agreement(part.counted_us, *signs, tuple(quartiles), *intervals_us)


def _signs(events: Events) -> tuple[int, int]:
    return int(np.sum(events.p > 0)), int(np.sum(events.p < 0))


def _in_blocks(events: Events) -> NDArray[np.int64]:
    row = events.y.astype(np.int64) * BLOCKS // events.height
    column = events.x.astype(np.int64) * BLOCKS // events.width
    return np.bincount(row * BLOCKS + column, minlength=BLOCKS**2)


def _interval_us(events: Events) -> float:
    """Return the median time between successive events of a pixel."""
    pixel = events.y.astype(np.int64) * events.width + events.x
    order = np.argsort(pixel, kind="stable")
    same = np.diff(pixel[order]) == 0
    return float(np.median(np.diff(events.t_us[order])[same])) if same.any() else math.nan
