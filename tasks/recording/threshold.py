"""The contrast thresholds, and the clock of the frames, as frames and events tell them.

Between two frames, log intensity changes by C_on times the number of brighter events less C_off
times that of the darker ones. Least squares over all pixels of all pairs finds both. A pixel's
weight is its light squared, as an error of log intensity is one of light in proportion to it: the
noise of a frame is in its codes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError
from tasks.recording.frames import Frames
from tasks.recording.pairs import PairSums, events_of, inside, sums
from tasks.recording.recording import Recording

REACH_US = 20_000
STEP_US = 1_000
_MOST_PAIRS = 5  # from which a shift is estimated


@dataclass(frozen=True, slots=True)
class Thresholds:
    """Contrast thresholds of a camera.

    Parameters
    ----------
    on, off
        Of brighter and darker events, log units.
    unexplained
        Share of the squared change between frames that the events do not explain; NaN if the
        thresholds were given.
    pairs
        Number of pairs of frames to which they were fitted; 0 if they were given.
    """

    on: float
    off: float
    unexplained: float = np.nan
    pairs: int = 0

    @property
    def mean(self) -> float:
        """One threshold for both polarities."""
        return 0.5 * (self.on + self.off)

    def change(self, found: PairSums) -> NDArray[np.float64]:
        """Return (H, W) the change of log intensity that events stand for."""
        return self.on * found.on - self.off * found.off


class _Fit:
    """Normal equations of the two thresholds."""

    def __init__(self) -> None:
        self._matrix = np.zeros((2, 2))
        self._vector = np.zeros(2)
        self._total = 0.0
        self._pairs = 0

    def add(self, before: NDArray, after: NDArray, found: PairSums) -> None:
        """Add a pair: log light before and after, and the events between."""
        weight = np.exp(2 * before).ravel()
        change = (after - before).ravel()
        columns = np.stack([found.on.ravel(), -found.off.ravel()])
        weighted = columns * weight
        self._matrix += weighted @ columns.T
        self._vector += weighted @ change
        self._total += float(weight @ change**2)
        self._pairs += 1

    def solve(self) -> Thresholds | None:
        """Return the thresholds, None if the events do not determine them."""
        if not (self._total > 0 and np.linalg.cond(self._matrix) < 1e8):
            return None
        C = np.linalg.solve(self._matrix, self._vector)
        unexplained = 1 - float(self._vector @ C) / self._total
        return Thresholds(float(C[0]), float(C[1]), unexplained, self._pairs)


def fit_thresholds(recording: Recording, frames: Frames) -> Thresholds:
    """Fit the contrast thresholds to all pairs of frames within a recording.

    Parameters
    ----------
    recording, frames
        The events and frames; a pair of events and two logarithms of frames are in memory.

    Returns
    -------
    Thresholds

    Raises
    ------
    TaskError
        The events do not explain the change of the frames.

    Examples
    --------
    >>> from tasks.recording.threshold import Thresholds
    >>> fitted = Thresholds(on=0.25, off=0.5)
    >>> fitted.mean
    0.375
    """
    pairs = inside(recording, frames)
    fit = _Fit()
    for k, events in zip(pairs, events_of(recording, frames, pairs), strict=True):
        fit.add(frames.log_light(k), frames.log_light(k + 1), sums(events, frames, k))
    found = fit.solve()
    if found is None or min(found.on, found.off) <= 0:
        said = "none" if found is None else f"ON {found.on:.3g}, OFF {found.off:.3g}"
        raise TaskError(
            f"{recording.path}: the thresholds that fit the frames best are {said}, expected "
            "positive ones; the clocks may disagree (--estimate-shift), or give --threshold"
        )
    return found


@dataclass(frozen=True, slots=True)
class Shift:
    """How much later than their times the frames fit the events best.

    Parameters
    ----------
    shift_us
        To add to the times of the frames.
    unexplained, unexplained_before
        Share of the squared change between frames that the events do not explain, with the shift
        and without.
    """

    shift_us: int
    unexplained: float
    unexplained_before: float

    @property
    def matters(self) -> bool:
        """Whether the frames fit the events visibly better with the shift."""
        return self.unexplained < self.unexplained_before - 0.05


def estimate_shift(recording: Recording, frames: Frames) -> Shift | None:
    """Estimate by how much the clocks of frames and events differ.

    The shift is that of the least unexplained change of the first pairs, of all within 20 ms in
    steps of 1 ms; a parabola through the best three gives its fraction. Not all of it comes from
    clocks: events follow when the light has changed by a threshold, and later in a slow sensor.

    Parameters
    ----------
    recording, frames
        The events and frames.

    Returns
    -------
    Shift
        None if no pair lies 20 ms within the recording, or the best shift is the largest.
    """
    pairs = inside(recording, frames, REACH_US)[:_MOST_PAIRS]
    shifts_us = np.arange(-REACH_US, REACH_US + STEP_US, STEP_US)
    fits = [_Fit() for _ in shifts_us]
    for k, events in zip(pairs, events_of(recording, frames, pairs, REACH_US), strict=True):
        before, after = frames.log_light(k), frames.log_light(k + 1)
        for shift_us, fit in zip(shifts_us, fits, strict=True):
            fit.add(before, after, sums(events, frames, k, int(shift_us)))
    solved = [fit.solve() for fit in fits]
    left = np.array([1.0 if one is None else one.unexplained for one in solved])
    best = int(np.argmin(left))
    if not 0 < best < len(left) - 1:
        return None
    low, middle, high = left[best - 1 : best + 2]
    curvature = low - 2 * middle + high
    fraction = 0.5 * (low - high) / curvature if curvature > 0 else 0.0
    found_us = int(np.rint(shifts_us[best] + fraction * STEP_US))
    return Shift(found_us, float(middle), float(left[len(left) // 2]))
