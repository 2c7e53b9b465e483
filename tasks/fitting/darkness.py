"""The dark level, from the numbers of events of dark and of bright pixels.

At any dark level, thresholds can be fitted that give about the right total number of events. But if
the level is too low, dark pixels fire too often; if it is too high, too rarely. At the right level,
the ratio of simulated to real events is the same for pixels of every brightness.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import EventCamera, Events, stream_bank
from sensor.representations import event_counts
from tasks.errors import TaskError
from tasks.fitting.check import Part
from tasks.numerics.estimate import Estimate, bootstrap, lowest, tiles_of
from tasks.recording.levels import Float64, Levels
from tasks.recording.motion import lag
from tasks.recording.threshold import FittedThresholds, fit_thresholds

DARK_SHARES = tuple(float(f"{level:.2g}") for level in np.geomspace(3e-4, 0.3, 13))
"""Dark levels of the sweep, shares of white."""

_CLASSES = 8  # of pixels by their brightness, with as many real events each
_LEAST = 400  # events
_LIGHT = 0.3  # log units: effect of errors of the light between frames, in simulations


class Swept(NamedTuple):
    """A dark level that was tried.

    Parameters
    ----------
    thresholds
        At this level.
    uneven
        Standard deviation of ln(simulated / real events) over the classes of brightness.
    """

    thresholds: FittedThresholds
    uneven: float


def sweep_dark(
    events: Events,
    part: Part,
    levels: Levels,
    coarse: Levels,
    camera: EventCamera,
    on_progress: Progress = silent,
) -> tuple[Estimate, tuple[Swept, ...]]:
    """Choose the dark level at which dark and bright pixels fire in the right proportion.

    At each level of a sweep, thresholds are fitted and the camera is simulated in the light. The
    choice is the level at which the ratio of simulated to real events varies least between eight
    classes of brightness. The mean of the ratio does not count. The interval is a bootstrap over
    tiles, widened by a factor of 1.35 for errors of the light.

    Parameters
    ----------
    events, part
        The recording, and the light of the part that is fitted.
    levels, coarse
        Its events with their light.
    camera
        The rest of the camera, with the grid of the recording.
    on_progress
        Called after each frame of the light.

    Returns
    -------
    The level, a share of white, with an open end if it may be beyond the sweep; and the sweep.

    Raises
    ------
    TaskError
        No level fits, or there are too few events.
    """
    late = lag(levels)
    fits = []
    for share in DARK_SHARES:
        with suppress(TaskError):  # nobody asked for this level
            fits.append(fit_thresholds(levels.at_dark(share), coarse.at_dark(share), *late))
    if not fits:
        fit_thresholds(levels, coarse, *late)  # whose error says why
    pixels = events.height * events.width
    counts = np.zeros((1 + len(fits), pixels), np.int64)
    counts[0] = event_counts(events.between(*part.counted_us)).sum(axis=0).ravel()
    if (total := int(counts[0].sum())) < _LEAST:
        raise TaskError(f"dark level: found {total} events, needs at least {_LEAST}; give --dark")
    brightness = np.zeros(pixels)

    def frames() -> Iterator[NDArray[np.float32]]:
        for frame in part.played("choosing the dark level", on_progress):
            brightness[:] += frame.ravel()
            yield frame

    models = [_behind(camera, fitted, *late).model() for fitted in fits]
    for k, simulated in stream_bank(frames(), part.light.t_s, models):
        counts[k + 1] += event_counts(part.counted(simulated)).sum(axis=0).ravel()
    order = np.argsort(brightness, kind="stable")
    until = np.cumsum(counts[0][order])
    of_class = np.empty(pixels, np.int64)
    of_class[order] = np.minimum(_CLASSES * until // total, _CLASSES - 1)
    tile = tiles_of(np.arange(pixels), events.width)
    tiles = int(tile.max()) + 1
    cell, size = tile * _CLASSES + of_class, tiles * _CLASSES
    sums = np.stack([np.bincount(cell, each, size).reshape(tiles, _CLASSES) for each in counts], 1)
    logs = np.log([fitted.dark for fitted in fits])

    def best(total: Float64) -> Float64:
        return np.array([lowest(logs, np.square(_uneven(total)))])

    (level,) = bootstrap(sums.reshape(tiles, -1).astype(np.float64), best)
    chosen = Estimate(
        math.exp(level.value),
        0.0 if level.low <= logs[0] else math.exp(level.low - _LIGHT),
        math.inf if level.high >= logs[-1] else math.exp(level.high + _LIGHT),
    )
    uneven = _uneven(sums.sum(axis=0).ravel().astype(np.float64))
    return chosen, tuple(map(Swept, fits, uneven.tolist()))


def _behind(
    camera: EventCamera, fitted: FittedThresholds, late_us: float, pole_s: float, poles: int
) -> EventCamera:
    """Return a camera with thresholds behind the filter with which they were fitted."""
    return replace(
        camera,
        contrast_threshold=fitted.on.value,
        contrast_threshold_off=fitted.off.value,
        photoreceptor="one_pole" if poles == 1 else "two_pole",
        cutoff_hz=1 / (2 * math.pi * pole_s) if pole_s > 1e-9 else math.inf,
        latency_s=max(0.0, 1e-6 * late_us),
        dark_share=fitted.dark,
        random_start=True,
    )


def _uneven(total: Float64) -> Float64:
    """Return (G,) standard deviations over the classes, from (1 + G) x classes numbers."""
    real, *others = total.reshape(-1, _CLASSES)
    return np.std(np.log((np.array(others) + 1) / (real + 1)), axis=1)
