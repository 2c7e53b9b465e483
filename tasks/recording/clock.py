"""The clock of the frames, from frames and events.

Near the right shift of the frames, events explain most of the change from frame to frame, whatever
an event is worth. At the right one, the light is at a level of the comparator at each event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tasks.errors import TaskError
from tasks.numerics.estimate import lowest
from tasks.recording.frames import DARK, RecordedFrames, check_frames, inside
from tasks.recording.levels import best_delay_us, levels_of, light_between
from tasks.recording.recording import Recording, cut
from tasks.recording.worth import solve_pairs

REACH_US = 20_000
STEP_US = 1_000
_MAX_PAIRS = 5  # pairs of frames that a shift is estimated from
_WORSE = 0.06  # of their change; at the right shift 0.04 or less, in simulations


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


def estimate_shift(recording: Recording, frames: RecordedFrames) -> Shift | None:
    """Estimate the difference between the clocks of frames and events.

    A first shift minimizes the unexplained change of the first five pairs, over 20 ms in both
    directions in steps of 1 ms, refined by a parabola through the best three. It is too late by the
    time in which the light changes by half a threshold or so, as events come only after that. The
    second step, in the same frames, has no such bias: it looks for the delay at which the light
    between the frames fits best from one event of a pixel to the next. What is left besides the
    clocks is the delay of the sensor itself. Where the image moves so far between frames that the
    light between them is not known, the second step fits the pairs worse, and the first one counts.

    Parameters
    ----------
    recording, frames
        The events and frames.

    Returns
    -------
    Shift
        None if no pair is 20 ms or more inside the recording, or the best shift is at either end.
    """
    pairs = inside(recording, frames, REACH_US)[:_MAX_PAIRS]
    shifts_us = range(-REACH_US, REACH_US + STEP_US, STEP_US)
    left = _unexplained(recording, frames, pairs, shifts_us)
    if not 0 < np.argmin(left) < len(left) - 1:
        return None
    first_us = round(lowest(np.array(shifts_us), np.array(left)))
    second_us = first_us + round(_lateness_us(recording, frames.later(first_us), pairs))
    first, second = _unexplained(recording, frames, pairs, (first_us, second_us))
    before = left[shifts_us.index(0)]
    if abs(second_us) <= REACH_US and second < first + _WORSE:
        return Shift(second_us, second, before)
    return Shift(first_us, first, before)


def _unexplained(
    recording: Recording, frames: RecordedFrames, pairs: Sequence[int], shifts_us: Sequence[int]
) -> list[float]:
    """Return the share of squared change that events do not explain, for each shift of frames."""
    solutions = solve_pairs(recording, frames, pairs, shifts_us)
    return [1.0 if solution is None else solution[1] for solution in solutions]


def _lateness_us(recording: Recording, frames: RecordedFrames, pairs: Sequence[int]) -> float:
    """Return how late events are to the light between some frames; 0 if these do not show it."""
    frames = frames.some(np.arange(pairs[0], pairs[-1] + 2))
    start_us, end_us = frames.middle_us[[0, -1]].tolist()
    events = next(cut(recording.parts(), [(start_us, end_us)]))
    try:
        return best_delay_us(levels_of(events, light_between(frames), DARK))
    except TaskError:
        return 0.0


def on_one_clock(
    recording: Recording, frames: RecordedFrames, shift_us: int | None, notes: list[str]
) -> RecordedFrames:
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
    shift = estimate_shift(recording, frames)
    if shift is None:
        if shift_us is None:
            reason = "no shift of the frames between -20 and 20 ms fits the events best"
            if not inside(recording, frames, REACH_US):
                reason = "no two successive frames lie at least 20 ms inside the events"
            raise TaskError(f"{recording.path}: {reason}; give --frames-shift-us")
        return frames
    after, before = (f"{100 * x:.0f} %" for x in (shift.unexplained, shift.unexplained_before))
    if shift_us is None:
        rest = f"the events leave {after} of their change unexplained, {before} without the shift"
        notes.append(f"frames: {_ms(shift.shift_us)} as estimated; {rest}")
        frames = frames.later(shift.shift_us)
        check_frames(recording, frames)
    elif shift.matters:
        given = f"--frames-shift-us {shift_us + shift.shift_us}"
        option = given if shift_us else "--estimate-shift"
        rest = f"{after} of their change stays unexplained, instead of {before}"
        best = f"clocks: the frames fit the events best {_ms(shift.shift_us)} ({rest})"
        notes.append(f"{best}; {option} applies this shift")
    return frames


def _ms(shift_us: int) -> str:
    return f"{abs(shift_us) / 1000:.1f} ms {'later' if shift_us >= 0 else 'earlier'}"
