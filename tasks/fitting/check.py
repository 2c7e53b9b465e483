"""Compare a fitted camera with events that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import Events
from sensor.cameras import EventCamera
from sensor.events import concatenate
from tasks.errors import TaskError
from tasks.fitting.parts import Part

BLOCKS = 4
"""Blocks of the image along each axis."""


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

    def frames() -> Iterator[NDArray[np.float32]]:
        for k, frame in enumerate(part.light, start=1):
            on_progress("checking", k, len(part.light))
            yield frame

    offset_us = part.light.t_offset_us
    stream = camera.stream(frames(), part.light.t_s, white=1.0)
    window_us = start_us - offset_us, end_us - offset_us
    simulated = concatenate([events.between(*window_us) for events in stream])
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
