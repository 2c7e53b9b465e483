"""Rates of pixels, and times between their events, Eq. (7)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler
from sensor.errors import EventError
from sensor.events import Columns, Events, whole_us

_NEVER = -(1 << 63)
_MAX_EDGE_US = 1e18  # int64 holds it
_MAX_US = 1 << 28  # of an edge; a byte or two of memory for each microsecond


@compiler(Path(__file__).parent)
def _count_intervals(
    events: Columns,
    start_us: int,
    end_us: int,
    slot_of: NDArray[np.int64],  # (height,) row of last_us for each row of pixels, -1 for none
    bin_of: NDArray[np.uint8],  # (longest interval + 2,) bin of each interval, us
    last_us: NDArray[np.int64],  # (rows, width) updated
    counts: NDArray[np.int64],  # (B + 2,) updated
) -> None:
    t_us, x, y, _ = events
    for i in range(t_us.size):
        row = slot_of[y[i]]
        if row < 0:
            continue
        before_us = last_us[row, x[i]]
        last_us[row, x[i]] = t_us[i]
        if before_us != _NEVER and start_us <= t_us[i] < end_us:
            counts[bin_of[min(t_us[i] - before_us, bin_of.size - 1)]] += 1


def _checked_edges(edges_us: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    edges = np.asarray(edges_us)
    right = edges.ndim == 1 and edges.size > 1 and np.issubdtype(edges.dtype, np.integer)
    if not (right and edges[0] >= 0 and edges[-1] < _MAX_US and np.all(edges[1:] > edges[:-1])):
        text = np.array2string(edges, threshold=4, edgeitems=2)
        raise EventError(
            f"IntervalHistogram: edges_us: found {text} of type {edges.dtype}, expected two or "
            "more increasing integers from 0 to 2^28 - 1 us"
        )
    return edges.astype(np.int64)


class IntervalHistogram:
    """Counts the times between consecutive events of each pixel in a stream.

    An interval counts if its second event is in the window; the first may be earlier. So intervals
    that are shorter than the stream before the window have full weight, and longer intervals have
    less.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    edges_us
        (B + 1,) bin edges, strictly ascending whole microseconds from 0 on, below 2^28 (268 s).
        Bins are half-open, [edge, next edge).
    window_us
        (start, end) of the half-open window, whole microseconds.
    every_row
        Use only every n-th row of pixels, an unbiased sample.

    Raises
    ------
    EventError
        An argument is invalid; the message names it.

    Attributes
    ----------
    counts : (B,) int64
        Intervals in each bin.
    shorter, longer : int
        Number of intervals below the first edge, and at or above the last.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.statistics import IntervalHistogram
    >>> t_us, x = np.array([0, 100, 300, 1200]), np.zeros(4, np.uint16)
    >>> events = Events(t_us, x, x, np.ones(4, np.int8), width=1, height=1)
    >>> histogram = IntervalHistogram(1, 1, edges_us=[50, 150, 450], window_us=(0, 2000))
    >>> histogram.add(events)
    >>> histogram.counts, histogram.longer
    (array([1, 1]), 1)
    """

    def __init__(
        self,
        width: int,
        height: int,
        edges_us: Sequence[int] | NDArray[np.int64],
        window_us: tuple[int, int],
        every_row: int = 1,
    ) -> None:
        self.edges_us = _checked_edges(edges_us)
        if len(window_us) != 2:
            raise EventError(f"IntervalHistogram: found {window_us=}, expected (start, end)")
        # Limited to int64, which holds the times of all events.
        start_us, end_us = (
            min(max(whole_us("IntervalHistogram", "window_us", t_us), _NEVER), -_NEVER - 1)
            for t_us in window_us
        )
        self._window_us = start_us, end_us
        for name, value in (("width", width), ("height", height), ("every_row", every_row)):
            if not isinstance(value, int | np.integer) or value < 1:
                raise EventError(
                    f"IntervalHistogram: found {name} = {value!r}, expected a positive integer"
                )
        self._slot_of = np.full(height, -1)
        self._slot_of[::every_row] = np.arange(-(-height // every_row))
        bins = len(self.edges_us) + 1  # with those below and above the edges
        self._bin_of = np.repeat(
            np.arange(bins, dtype=np.min_scalar_type(bins)),
            np.diff(self.edges_us, prepend=0, append=self.edges_us[-1] + 2),
        )
        self._last_us = np.full((-(-height // every_row), width), _NEVER)
        self._counts = np.zeros(len(self.edges_us) + 1, np.int64)
        self._start_us: int | None = None
        self._end_us = 0

    def add(self, events: Events) -> None:
        """Count the next part of the stream.

        Raises
        ------
        EventError
            The events are from a sensor of another size, start before the end of the previous part,
            or end 2^63 us after the first event.
        """
        width, height = self._last_us.shape[1], len(self._slot_of)
        if (events.width, events.height) != (width, height):
            raise EventError(
                f"IntervalHistogram.add: found events of {events.width}x{events.height} px, "
                f"expected {width}x{height} px"
            )
        if not len(events):
            return
        first_us, last_us = events.t_us[[0, -1]].tolist()
        if self._start_us is None:
            self._start_us = self._end_us = first_us
        if first_us < self._end_us or last_us - self._start_us >= 1 << 63:
            raise EventError(
                f"IntervalHistogram.add: found events from {first_us} to {last_us} us after events "
                f"from {self._start_us} to {self._end_us} us; add parts in order of time, all "
                "within less than 2^63 us"
            )
        self._end_us = last_us
        slot_of, bin_of = self._slot_of, self._bin_of
        _count_intervals(
            events.columns, *self._window_us, slot_of, bin_of, self._last_us, self._counts
        )

    @property
    def counts(self) -> NDArray[np.int64]:
        return self._counts[1:-1].copy()

    @property
    def shorter(self) -> int:
        return int(self._counts[0])

    @property
    def longer(self) -> int:
        return int(self._counts[-1])


def event_rates_hz(events: Events, t_start_us: int, t_end_us: int) -> NDArray[np.float64]:
    """Return the event rate of each pixel in a window.

    Parameters
    ----------
    events
        The stream.
    t_start_us, t_end_us
        The window [t_start_us, t_end_us).

    Returns
    -------
    (height, width) float64, 1/s

    Raises
    ------
    EventError
        A time is not an integer, or the window is empty.

    Examples
    --------
    A pixel that fires a hundred times as often as its neighbors is hot:

    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.statistics import event_rates_hz
    >>> t_us, x = np.arange(0, 10_000, 100), np.zeros(100, np.uint16)
    >>> events = Events(t_us, x, x, np.ones(100, np.int8), width=3, height=1)
    >>> event_rates_hz(events, 0, 10_000)
    array([[10000.,     0.,     0.]])
    """
    window = events.between(t_start_us, t_end_us)
    t_start_us, t_end_us = int(t_start_us), int(t_end_us)  # differences of int32 may overflow
    if t_end_us <= t_start_us:
        raise EventError(f"event_rates_hz: the window from {t_start_us} to {t_end_us} us is empty")
    pixel = window.y.astype(np.int64) * events.width + window.x
    counts = np.bincount(pixel, minlength=events.height * events.width)
    return counts.reshape(events.height, events.width) / ((t_end_us - t_start_us) * 1e-6)


def log_bin_edges_us(
    shortest_us: float = 10.0, longest_us: float = 1e5, per_decade: int = 10
) -> NDArray[np.int64]:
    """Return logarithmically spaced bin edges, rounded to whole microseconds.

    Parameters
    ----------
    shortest_us, longest_us
        First edge, at least 1 us, and approximate last edge, at most 10^18 us. The number of bins
        is whole; it brings the last edge as near as possible.
    per_decade
        Number of bins per decade.

    Returns
    -------
    (B + 1,) int64

    Raises
    ------
    EventError
        An edge or the number of bins is out of range.

    Examples
    --------
    >>> from sensor.statistics import log_bin_edges_us
    >>> log_bin_edges_us(10, 1000, per_decade=3)
    array([  10,   22,   46,  100,  215,  464, 1000])
    """
    right = 1 <= shortest_us < longest_us <= _MAX_EDGE_US
    bins = np.log10(longest_us / shortest_us) * per_decade if right else 0.0
    if not bins >= 0.5:
        raise EventError(
            f"log_bin_edges_us: found {shortest_us} to {longest_us} us with per_decade = "
            f"{per_decade}, expected increasing times from 1 to {_MAX_EDGE_US:g} us, and at least "
            "one bin between them"
        )
    steps = np.arange(round(bins) + 1) / per_decade
    return np.unique(np.round(shortest_us * 10**steps).astype(np.int64))


def mode_us(
    edges_us: Sequence[int] | NDArray[np.int64], counts: Sequence[int] | NDArray[np.int64]
) -> float | None:
    """Return the mode of a histogram over log time.

    Parameters
    ----------
    edges_us
        (B + 1,) ascending bin edges, positive.
    counts
        (B,) counts, which are divided by the widths of the bins in log time.

    Returns
    -------
    float or None
        Geometric center of the highest bin, us; None without counts.

    Examples
    --------
    >>> from sensor.statistics import mode_us
    >>> mode_us([10, 100, 1000], [3, 8])
    316.22776601683796
    """
    edges = np.asarray(edges_us, dtype=np.float64)
    if not np.any(counts):
        return None
    k = int(np.argmax(np.asarray(counts) / np.diff(np.log(edges))))
    return float(np.sqrt(edges[k] * edges[k + 1]))
