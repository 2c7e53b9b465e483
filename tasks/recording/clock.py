"""The clock of the frames, as frames and events tell it.

Between two frames, log intensity changes by C_on times the number of brighter events less C_off
times that of the darker ones. Least squares over all pixels of some pairs finds how well the events
explain the change, whatever the thresholds are, for each shift of the frames. A pixel's weight is
its light squared, as an error of log intensity is one of light in proportion to it: the noise of a
frame is in its codes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError
from tasks.recording.frames import Frames
from tasks.recording.pairs import PairSums, check_frames, events_of, inside, sums
from tasks.recording.recording import Recording

REACH_US = 20_000
STEP_US = 1_000
_MOST_PAIRS = 5  # from which a shift is estimated


class _Explained:
    """How much of the change between frames the events explain: normal equations."""

    def __init__(self) -> None:
        self._matrix = np.zeros((2, 2))
        self._vector = np.zeros(2)
        self._total = 0.0

    def add(self, before: NDArray, after: NDArray, found: PairSums) -> None:
        """Add a pair: log light before and after, and the events between."""
        weight = np.exp(2 * before).ravel()
        change = (after - before).ravel()
        columns = np.stack([found.on.ravel(), -found.off.ravel()])
        weighted = columns * weight
        self._matrix += weighted @ columns.T
        self._vector += weighted @ change
        self._total += float(weight @ change**2)

    def unexplained(self) -> float:
        """Return the share of the squared change that stays, 1 if the events determine nothing."""
        if not (self._total > 0 and np.linalg.cond(self._matrix) < 1e8):
            return 1.0
        return 1 - float(self._vector @ np.linalg.solve(self._matrix, self._vector)) / self._total


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
    fits = [_Explained() for _ in shifts_us]
    for k, events in zip(pairs, events_of(recording, frames, pairs, REACH_US), strict=True):
        before, after = frames.log_light(k), frames.log_light(k + 1)
        for shift_us, fit in zip(shifts_us, fits, strict=True):
            fit.add(before, after, sums(events, frames, k, int(shift_us)))
    left = np.array([fit.unexplained() for fit in fits])
    best = int(np.argmin(left))
    if not 0 < best < len(left) - 1:
        return None
    low, middle, high = left[best - 1 : best + 2]
    curvature = low - 2 * middle + high
    fraction = 0.5 * (low - high) / curvature if curvature > 0 else 0.0
    found_us = int(np.rint(shifts_us[best] + fraction * STEP_US))
    return Shift(found_us, float(middle), float(left[len(left) // 2]))


def on_one_clock(
    recording: Recording, frames: Frames, shift_us: int | None, notes: list[str]
) -> Frames:
    """Move frames to the clock of the events, and note what was done.

    Parameters
    ----------
    recording, frames
        The events and frames.
    shift_us
        Added to the times of the frames; None estimates it.
    notes
        Sentences are appended.

    Returns
    -------
    Frames

    Raises
    ------
    TaskError
        No shift fits, or the frames are not those of the recording.
    """
    notes.append(f"frames: {len(frames)}, decoded as {frames.encoding}")
    if shift_us:
        frames = frames.later(shift_us)
        notes.append(f"frames: {_ms(shift_us)} as given")
    check_frames(recording, frames)
    found = estimate_shift(recording, frames)
    if shift_us is None:
        if found is None:
            raise TaskError(
                f"{recording.path}: found no shift of the frames between -20 and 20 ms that fits "
                "the events best; give it with --frames-shift-us"
            )
        notes.append(
            f"frames: {_ms(found.shift_us)} as estimated; events then leave "
            f"{100 * found.unexplained:.0f} % of their change unexplained, "
            f"{100 * found.unexplained_before:.0f} % without"
        )
        frames = frames.later(found.shift_us)
        check_frames(recording, frames)
    elif found is not None and found.matters:
        notes.append(
            f"clocks: the frames fit the events best {_ms(found.shift_us)} ("
            f"{100 * found.unexplained:.0f} % of their change unexplained, not "
            f"{100 * found.unexplained_before:.0f} %); not done, --estimate-shift does it"
        )
    return frames


def _ms(shift_us: int) -> str:
    return f"{abs(shift_us) / 1000:.1f} ms {'later' if shift_us >= 0 else 'earlier'}"
