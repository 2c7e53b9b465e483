"""One number per pixel and polarity: how many events, and how long ago the last one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensor.errors import EventError
from sensor.events import Columns, Events, whole_us
from sensor.representations.compiling import jit

_MIN_TAU_US = 1e-300  # its inverse is finite


def event_counts(events: Events) -> NDArray[np.int32]:
    """Count the events of each pixel.

    Returns
    -------
    counts
        (2, height, width) int32: OFF events, ON events. For their signed sum, see
        `Events.polarity_sum`.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.representations import event_counts
    >>> x, y = np.array([[0, 1, 1], [0, 0, 0]], np.uint16)
    >>> p = np.array([1, -1, 1], np.int8)
    >>> events = Events(np.array([0, 250, 1000]), x, y, p, width=2, height=1)
    >>> off, on = event_counts(events)
    >>> off, on
    (array([[0, 1]], dtype=int32), array([[1, 1]], dtype=int32))
    """
    counts = np.zeros((2, events.height, events.width), np.int32)
    _count(events.columns, counts)
    return counts


@jit
def _count(events: Columns, counts: NDArray[np.int32]) -> None:
    for k in range(events.x.size):
        counts[np.int64(events.p[k] > 0), events.y[k], events.x[k]] += 1


def time_surface(events: Events, tau_us: float, t_us: int | None = None) -> NDArray[np.float32]:
    """Return an exponentially decaying time surface.

    Parameters
    ----------
    events
        Events up to `t_us`.
    tau_us
        Time constant of the decay, microseconds.
    t_us
        Time of the surface, microseconds. The default is the time of the last event.

    Returns
    -------
    surface
        (2, height, width) float32 in [0, 1]: exp(-(t_us - t) / tau_us), where t is the time of a
        pixel's last OFF event and last ON event; 0 without an event. HATS (CVPR 2018), Eq. (2).

    Raises
    ------
    EventError
        An event is later than `t_us`, `t_us` is not an integer, or `tau_us` is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.representations import time_surface
    >>> x, y = np.array([[0, 1, 1], [0, 0, 0]], np.uint16)
    >>> p = np.array([1, -1, 1], np.int8)
    >>> events = Events(np.array([0, 250, 1000]), x, y, p, width=2, height=1)
    >>> off, on = time_surface(events, tau_us=1000.0)
    >>> off.round(3), on.round(3)
    (array([[0.   , 0.472]], dtype=float32), array([[0.368, 1.   ]], dtype=float32))
    """
    if not tau_us > 0:
        raise EventError(f"time_surface: found tau_us = {tau_us}, expected a positive number")
    if t_us is None:
        t_us = int(events.t_us[-1]) if len(events) else 0
    t_us = whole_us("time_surface", "t_us", t_us)
    for event_us in map(int, events.t_us[[0, -1]] if len(events) else ()):
        if not 0 <= t_us - event_us < 1 << 63:
            raise EventError(
                f"time_surface: the event at {event_us} us is after t_us = {t_us}, or 2^63 us or "
                "more before it; select a window with `Events.between`"
            )
    surface = np.zeros((2, events.height, events.width), np.float32)
    if len(events):  # without, any time will do, also one beyond int64
        _decay(events.columns, t_us, max(tau_us, _MIN_TAU_US), surface)
    return surface


@jit
def _decay(events: Columns, t_us: int, tau_us: float, surface: NDArray[np.float32]) -> None:
    rate = 1 / tau_us
    for k in range(events.x.size):
        age_us = np.float64(t_us - events.t_us[k])
        surface[np.int64(events.p[k] > 0), events.y[k], events.x[k]] = np.exp(-rate * age_us)
