"""High-pass filter (HF): each pixel integrates its events and decays.

Scheerlinck, Barnes and Mahony, "Continuous-time Intensity Estimation Using Event Cameras" (ACCV
2018), from events alone. A pixel's log intensity L follows

    dL/dt = -omega L + sum over its events of p C delta(t - t_k),

so an event after dt multiplies L by exp(-omega dt) and adds p C. This is a high-pass filter, with
its -3 dB point at omega rad/s, of the signal that the events sample. The authors' program, from
which our defaults are, has the cutoff in Hz, omega = 2 pi f, and also multiplies L by exp(-d) at
each event, with a decay d per event. 0.06 Hz is a time constant of 2.65 s. 0.06 per event is a
constant of 17 events, which matters more at busy pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.events import Columns
from tasks.errors import TaskError
from tasks.numerics.compiling import jit_in_place

CUTOFF_HZ = 0.06
PER_EVENT_DECAY = 0.06
AHEAD = 256  # events per group of pixels that are read ahead


class HighPassFilter:
    """The filter of one sensor, at zero until its first event.

    With a decay d per event, a pixel's value stays within C / (1 - exp(-d)) of 0.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    contrast_threshold
        C, log units.
    cutoff_hz
        Cutoff of the high-pass filter; 0 for no decay with time.
    per_event_decay
        Decay d of a pixel at each of its events.

    Raises
    ------
    TaskError
        A number is out of range.
    """

    def __init__(
        self,
        width: int,
        height: int,
        contrast_threshold: float,
        cutoff_hz: float = CUTOFF_HZ,
        per_event_decay: float = PER_EVENT_DECAY,
    ) -> None:
        for name, value in (("cutoff_hz", cutoff_hz), ("per_event_decay", per_event_decay)):
            if not 0 <= value < math.inf:
                raise TaskError(f"high-pass filter: {name}: found {value}, expected 0 or more")
        self._decay_per_us = 2e-6 * math.pi * cutoff_hz
        self._rates = contrast_threshold, self._decay_per_us, per_event_decay
        self._state = np.zeros((height, width, 2))  # L after the latest event, its time in us
        self._places = np.empty(AHEAD, np.uint64)
        self._t_us: int | None = None  # of the latest event

    def push(self, events: Events) -> None:
        """Take in the next events.

        Raises
        ------
        TaskError
            The events are from a sensor of another size, or begin before the latest one.
        """
        height, width, _ = self._state.shape
        if (events.width, events.height) != (width, height):
            raise TaskError(
                f"high-pass filter: found events of {events.width}x{events.height} px, expected "
                f"{width}x{height}"
            )
        if not len(events):
            return
        self._check_order(int(events.t_us[0]))
        self._t_us = int(events.t_us[-1])
        _filter(self._state.ravel(), width, events.columns, self._rates, self._places)

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Return log intensity, (height, width), 0 at pixels without recent events.

        Raises
        ------
        TaskError
            The time is before the latest event.
        """
        self._check_order(t_us)
        value, last_us = self._state[..., 0], self._state[..., 1]
        since_us = np.where(value != 0, t_us - last_us, 0.0)
        return value * np.exp(-self._decay_per_us * since_us)

    def _check_order(self, t_us: int) -> None:
        if self._t_us is not None and t_us < self._t_us:
            raise TaskError(
                f"high-pass filter: found the time {t_us} us, expected at least {self._t_us} us, "
                "the time of the last event"
            )


def without_event_decay(width: int, height: int, contrast_threshold: float) -> HighPassFilter:
    """Make the filter as in the paper: pixels decay only with time.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    contrast_threshold
        C, log units.

    Returns
    -------
    The filter.
    """
    return HighPassFilter(width, height, contrast_threshold, per_event_decay=0.0)


@jit_in_place
def _filter(
    state: NDArray[np.float64],  # (2 * pixels,) L and time of each pixel, row by row
    width: int,
    events: Columns,
    rates: tuple[float, float, float],  # C in log units, decay per us, decay per event
    places: NDArray[np.uint64],  # (AHEAD,) overwritten: index of each event's L in the state
) -> float:
    # Pixels are read ahead in groups, so that their independent loads overlap.
    t_us, x, y, p = events
    C, decay_per_us, decay_per_event = rates
    next_row, next_one = np.uint64(width), np.uint64(1)
    touched = 0.0
    for start in range(0, t_us.size, places.size):
        count = min(places.size, t_us.size - start)
        for k in range(count):
            places[k] = np.uint64(2) * (y[start + k] * next_row + x[start + k])
        for k in range(count):
            touched += state[places[k]]
        for k in range(count):
            here = places[k]
            L, last_us = state[here], state[here + next_one]
            if L != 0.0:
                decay = decay_per_us * (t_us[start + k] - last_us) + decay_per_event
                L *= math.exp(-decay)
            state[here] = L + p[start + k] * C
            state[here + next_one] = t_us[start + k]
    return touched  # so that the compiler keeps the reads
