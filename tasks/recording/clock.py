"""The clock of the frames, from frames and events.

At the right shift of the frames, events explain most of the change from frame to frame, whatever
an event is worth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tasks.errors import TaskError
from tasks.recording.frames import Frames
from tasks.recording.pairs import check_frames, events_of, inside, sums
from tasks.recording.recording import Recording
from tasks.recording.worth import Explained

REACH_US = 20_000
STEP_US = 1_000
_MOST_PAIRS = 5  # pairs of frames that a shift is estimated from


@dataclass(frozen=True, slots=True)
class Shift:
    """Shift of the frames at which they fit the events best.

    Parameters
    ----------
    shift_us
        Shift to add to the times of the frames, microseconds.
    unexplained, unexplained_before
        Share of the squared change between frames that the events do not explain, with the shift
        and without.
    """

    shift_us: int
    unexplained: float
    unexplained_before: float

    @property
    def matters(self) -> bool:
        """Whether the frames fit the events clearly better with the shift."""
        return self.unexplained < self.unexplained_before - 0.05


def estimate_shift(recording: Recording, frames: Frames) -> Shift | None:
    """Estimate the difference between the clocks of frames and events.

    The shift minimizes the unexplained change of the first five pairs, over 20 ms in both
    directions in steps of 1 ms, refined by a parabola through the best three. Not all of it comes
    from clocks: events come after the light has changed by a threshold, and later in a slow sensor.

    Parameters
    ----------
    recording, frames
        The events and frames.

    Returns
    -------
    Shift
        None if no pair is 20 ms or more inside the recording, or the best shift is at either end.
    """
    pairs = inside(recording, frames, REACH_US)[:_MOST_PAIRS]
    shifts_us = np.arange(-REACH_US, REACH_US + STEP_US, STEP_US)
    fits = [Explained() for _ in shifts_us]
    for k, events in zip(pairs, events_of(recording, frames, pairs, REACH_US), strict=True):
        before, after = frames.log_light(k), frames.log_light(k + 1)
        for shift_us, fit in zip(shifts_us, fits, strict=True):
            fit.add(before, after, sums(events, frames, k, int(shift_us)))
    left = np.array([1.0 if one is None else one[1] for one in (fit.solve() for fit in fits)])
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
        Added to the times of the frames, microseconds; None estimates it.
    notes
        List to append sentences to.

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
            tried = "shift of the frames between -20 and 20 ms that fits the events best"
            if not inside(recording, frames, REACH_US):
                tried = "two frames in a row that are 20 ms or more within the events"
            raise TaskError(
                f"{recording.path}: found no {tried}; give the shift with --frames-shift-us"
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
