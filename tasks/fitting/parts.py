"""`Part`: the light of one half of a recording, or of all of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import Literal, NamedTuple

import numpy as np

from sensor import Events
from tasks.errors import TaskError
from tasks.footage import Footage
from tasks.recording.frames import RecordedFrames
from tasks.recording.levels import SETTLING, busiest, every_second, light_between
from tasks.recording.motion import INTERPOLATED, KNOWN

Check = Literal["second", "first", "none"]
"""The half that is held out."""

_LEAST = 5  # frames: three of each half, the middle one in both


class Part(NamedTuple):
    """Light of a part of a recording.

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


def parts_of(
    events: Events, light: RecordedFrames | Footage, check: Check
) -> tuple[Part, Part | None]:
    """Divide what a camera saw in time.

    Returns
    -------
    The part to fit, and the held-out half, None for "none". A held-out second half begins one frame
    before the middle, so that its pixels have settled there.
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
