"""What an event is worth between two frames, to predict the second from the first.

At a frame, the log light of a pixel is anywhere between two levels of its comparator, and some
events are noise. So a prediction is best if an event counts for less than a threshold, or for more
if events are missing. Least squares over all pixels of all pairs of frames finds its worth. The
weight of a pixel is its light squared, as an error of log intensity is an error of light in
proportion to the light, and the noise of a frame is in its light. `tasks.recording.threshold` fits
the thresholds themselves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError
from tasks.recording.frames import RecordedFrames, inside, sums
from tasks.recording.recording import Recording, cut
from tasks.recording.threshold import Thresholds


class Explained:
    """Normal equations of the change between frames that events explain."""

    def __init__(self) -> None:
        self._matrix = np.zeros((2, 2))
        self._vector = np.zeros(2)
        self._total = 0.0

    def add(self, before: NDArray, after: NDArray, between: NDArray) -> None:
        """Add a pair of frames.

        Parameters
        ----------
        before, after
            (H, W) log light of both.
        between
            (2, H, W) sums of the brighter and of the darker events between.
        """
        weight = np.exp(2 * before).ravel()
        change = (after - before).ravel()
        columns = np.stack([between[0].ravel(), -between[1].ravel()])
        weighted = columns * weight
        self._matrix += weighted @ columns.T
        self._vector += weighted @ change
        self._total += float(weight @ change**2)

    def solve(self) -> tuple[Thresholds, float] | None:
        """Return what ON and OFF events are worth, and the unexplained share of squared change.

        None if the events do not determine them.
        """
        if not (self._total > 0 and np.linalg.cond(self._matrix) < 1e8):
            return None
        worth = np.linalg.solve(self._matrix, self._vector)
        unexplained = 1 - float(self._vector @ worth) / self._total
        return Thresholds(float(worth[0]), float(worth[1])), unexplained


def solve_pairs(
    recording: Recording, frames: RecordedFrames, pairs: Sequence[int], shifts_us: Sequence[int]
) -> list[tuple[Thresholds, float] | None]:
    """Solve the normal equations of some pairs of frames, for each of some shifts of the frames.

    Parameters
    ----------
    recording, frames
        The events and frames; only one pair of frames and its events are in memory at a time.
    pairs
        Indices of the first frames of the pairs, ascending.
    shifts_us
        Added to the times of the frames, microseconds.

    Returns
    -------
    As `Explained.solve`, for each shift.
    """
    fits = [Explained() for _ in shifts_us]
    starts_us, ends_us = frames.start_us + min(shifts_us), frames.end_us + max(shifts_us)
    windows = [(int(starts_us[k]), int(ends_us[k + 1])) for k in pairs]
    for k, events in zip(pairs, cut(recording.parts(), windows), strict=True):
        before, after = frames.log_light(k), frames.log_light(k + 1)
        for shift_us, fit in zip(shifts_us, fits, strict=True):
            fit.add(before, after, sums(events, frames, k, shift_us))
    return [fit.solve() for fit in fits]


def worth_of_events(recording: Recording, frames: RecordedFrames) -> tuple[Thresholds, float]:
    """Fit what events are worth to all pairs of frames within a recording.

    Parameters
    ----------
    recording, frames
        The events and frames; only one pair of frames and its events are in memory at a time.

    Returns
    -------
    What ON and OFF events are worth, log units, and the share of the squared change between frames
    that they do not explain.

    Raises
    ------
    TaskError
        The events do not explain the change of the frames.
    """
    (solution,) = solve_pairs(recording, frames, inside(recording, frames), [0])
    if solution is None or min(solution[0]) <= 0:
        worth = "undetermined" if solution is None else "ON {:.3g}, OFF {:.3g}".format(*solution[0])
        best = f"{recording.path}: the thresholds fitted to the frames are {worth}"
        raise TaskError(f"{best}, expected above 0; try --estimate-shift, or give --threshold")
    return solution
