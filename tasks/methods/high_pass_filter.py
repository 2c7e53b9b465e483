"""High-pass filter (HF): each pixel adds up its events, and decays.

Scheerlinck, Barnes and Mahony, "Continuous-time Intensity Estimation Using Event Cameras" (ACCV
2018), from events alone. A pixel's log intensity L follows

    dL/dt = -omega L + sum over its events of p C delta(t - t_k),

so an event after dt multiplies L by exp(-omega dt) and adds p C. This is a high-pass filter, with
its -3 dB point at omega rad/s, of the signal that the events sample. The authors' program, which
gives our defaults, has the cutoff in Hz, omega = 2 pi f, and also multiplies L by exp(-d) at each
event, with a decay d per event. 0.06 Hz is a time constant of 2.65 s, 0.06 per event one of 17
events: the latter matters more at busy pixels.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.errors import TaskError
from tasks.numerics.compiling import jit

CUTOFF_HZ = 0.06
PER_EVENT_DECAY = 0.06
_AHEAD = 256  # events per group of pixels that are read ahead


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
        Cutoff of the high-pass; 0 never decays with time.
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
        self._C = contrast_threshold
        self._per_us = 2e-6 * math.pi * cutoff_hz
        self._per_event = per_event_decay
        self._state = np.zeros((height, width, 2))  # L after the latest event, its time in us
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
        _filter(
            self._state, events.t_us, events.x, events.y, events.p,
            self._C, self._per_us, self._per_event,
        )  # fmt: skip

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Return log intensity, (height, width), 0 at pixels without recent events.

        Raises
        ------
        TaskError
            The time is before the latest event.
        """
        self._check_order(t_us)
        value, last_us = self._state[..., 0], self._state[..., 1]
        seen = value != 0
        return value * np.exp(-self._per_us * np.where(seen, t_us - last_us, 0.0))

    def _check_order(self, t_us: int) -> None:
        if self._t_us is not None and t_us < self._t_us:
            raise TaskError(
                f"high-pass filter: found {t_us} us, expected at least {self._t_us} us, the "
                "time of the last event"
            )


def without_event_decay(width: int, height: int, contrast_threshold: float) -> HighPassFilter:
    """Make the filter as in the paper: pixels decay with time alone.

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


@jit
def _filter(
    state: NDArray[np.float64],  # (height, width, 2)
    t_us: NDArray[np.int64],
    x: NDArray[np.uint16],
    y: NDArray[np.uint16],
    p: NDArray[np.int8],
    C: float,
    per_us: float,
    per_event: float,
) -> float:
    # Pixels are read ahead in groups, with few instructions from one to the next: loads that do not
    # depend on each other overlap.
    values, width = state.ravel(), np.uint64(state.shape[1])
    place = np.empty(_AHEAD, np.uint64)  # of each event's L; the time is next to it
    touched = 0.0
    for start in range(0, t_us.size, _AHEAD):
        count = min(_AHEAD, t_us.size - start)
        for k in range(count):
            place[k] = np.uint64(2) * (y[start + k] * width + x[start + k])
        for k in range(count):
            touched += values[place[k]]
        for k in range(count):
            here = place[k]
            L, last_us = values[here], values[here + np.uint64(1)]
            if L != 0.0:
                L *= math.exp(-(per_us * (t_us[start + k] - last_us) + per_event))
            values[here] = L + p[start + k] * C
            values[here + np.uint64(1)] = t_us[start + k]
    return touched  # used, so that the compiler keeps the reads
