"""Readout: a FIFO and a bus of limited rate that sends the events of a row together.

    parts = read_out(stream(frames, t_s, model), Readout(max_rate_hz=12e6, fifo_depth=4096))
    for events in parts: ...
    parts.report.dropped_share

The model, after the burst-mode word-serial link of Boahen (IEEE TCAS-I 2004), the readout of the
DAVIS (Brandli et al., JSSC 2014) and the row-wise arbitration of later sensors (Finateu et al.,
ISSCC 2020):

- An event enters the FIFO when it fires. It is dropped if the FIFO has `fifo_depth` events. Events
  of the same microsecond enter in the order of the stream, (row, column) for simulated ones.
- When the bus is free, it serves the row with the oldest waiting event. It sends all waiting events
  of that row together: `row_overhead_s` for the address of the row, then one event every
  `1 / max_rate_hz`, oldest first. Later events of that row wait for its next turn.
- An event leaves the FIFO when it is sent, and gets the time at which it left. Nothing is random.

A simplification: in a chip without a FIFO each pixel stores its event until it is read, and
compares again only then. Under load it loses contrast, not events.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from sensor.errors import EventError
from sensor.events import Columns, Events, concatenate
from sensor.kernels import fifo
from sensor.numbers import FINITE, POSITIVE, real, refusal, whole

_MAX_SLOTS = 100_000_000  # of a FIFO, which is in memory


@dataclass(frozen=True, slots=True, kw_only=True)
class Readout:
    """A bus and its FIFO.

    Parameters
    ----------
    max_rate_hz
        Maximum event rate of the bus within a row, events per second. Data sheets use Mev/s: 12e6
        is a DAVIS346.
    fifo_depth
        Maximum number of waiting events, including the one on the bus.
    row_overhead_s
        Time to open a row, seconds. With n events per row the rate is
        `n / (row_overhead_s + n / max_rate_hz)`.

    Raises
    ------
    SensorError
        A parameter is out of range or not a number; the message names it.

    Examples
    --------
    The bus of a DAVIS346, from Table 1 of the paper:

    >>> from sensor import find_camera
    >>> find_camera("davis346").bus
    Readout(max_rate_hz=12000000.0, fifo_depth=4096, row_overhead_s=0.0)
    """

    max_rate_hz: float
    fifo_depth: int
    row_overhead_s: float = 0.0

    def __post_init__(self) -> None:
        for name, check, expected, low, high in (
            ("max_rate_hz", real, "a positive number of events per second", POSITIVE, FINITE),
            ("fifo_depth", whole, f"an integer from 1 to {_MAX_SLOTS:,}", 1, _MAX_SLOTS),
            ("row_overhead_s", real, "0 or more seconds", 0, FINITE),
        ):
            number = check(f"Readout.{name}", getattr(self, name), expected, low, high)
            object.__setattr__(self, name, number)  # a Python number, for files


@dataclass(frozen=True, slots=True)
class ReadoutReport:
    """Counts and delays of a readout.

    Attributes
    ----------
    fired
        Events of the pixels.
    dropped
        Events lost because the FIFO was full.
    delayed
        Events sent in a later microsecond than they fired.
    mean_delay_s, max_delay_s
        Delay of the sent events, before rounding to microseconds; 0 if none was sent.

    Examples
    --------
    >>> from sensor import ReadoutReport
    >>> report = ReadoutReport(
    ...     fired=2000, dropped=500, delayed=900, mean_delay_s=2e-6, max_delay_s=9e-6
    ... )
    >>> report.dropped_share
    0.25
    >>> print(report)
    2000 events fired, 500 dropped (25 %), 900 delayed, by 2 us on average and 9 us at most
    """

    fired: int
    dropped: int
    delayed: int
    mean_delay_s: float
    max_delay_s: float

    @property
    def dropped_share(self) -> float:
        """Dropped share of the fired events; 0 if none fired."""
        return self.dropped / self.fired if self.fired else 0.0

    def __str__(self) -> str:
        share = f"{100 * self.dropped_share:.3g} %"
        return (
            f"{self.fired} events fired, {self.dropped} dropped ({share}), "
            f"{self.delayed} delayed, by {1e6 * self.mean_delay_s:.3g} us on average and "
            f"{1e6 * self.max_delay_s:.3g} us at most"
        )


class Sender:
    """A bus that gets the events of one stream part by part."""

    def __init__(self, readout: Readout) -> None:
        self._readout = readout
        self._tally = fifo.Tally(np.zeros(fifo.COUNTS_SIZE, np.int64), np.zeros(fifo.DELAYS_SIZE))
        self._waiting: _Queue | None = None
        self._held: Events | None = None
        self._end_us = -fifo.END_OF_TIME_US

    def push(self, part: Events, until_us: int | None = None) -> Events:
        """Take the next events of the pixels; return events that have left before `until_us`.

        No event of a later part is earlier than `until_us`; None is the time of the last event.
        """
        for t_us in part.t_us[[0, -1]].tolist() if len(part) else ():
            if abs(t_us) >= fifo.END_OF_TIME_US:  # differences would overflow
                raise EventError(
                    f"read_out: an event at {t_us} us is out of range, expected |t| < 2^62 us"
                )
        if self._waiting is None or self._held is None:
            self._waiting, self._held = _Queue(self._readout, part.height), part[:0].copy()
        held = self._held
        if (part.width, part.height) != (held.width, held.height):
            raise EventError(
                f"read_out: a part of {part.width}x{part.height} px follows a part of "
                f"{held.width}x{held.height} px; give the parts of one stream"
            )
        if len(part) and part.t_us[0] < self._end_us:
            raise EventError(
                f"read_out: a part begins at {part.t_us[0]} us, but the previous part ends at "
                f"{self._end_us} us; give consecutive parts of one stream"
            )
        if until_us is None:
            until_us = int(part.t_us[-1]) if len(part) else self._end_us
        self._end_us = until_us
        sent = concatenate([held, self._waiting.take(part, until_us, self._tally)])
        final = int(np.searchsorted(sent.t_us, until_us))
        self._held = sent[final:].copy()
        return _in_order(sent[:final])

    def finish(self) -> Events | None:
        """Return the events that leave after the last part; None if there was no part."""
        if self._waiting is None or self._held is None:
            return None
        held, self._held = self._held, self._held[:0]
        return _in_order(concatenate([held, self._waiting.drain(held, self._tally)]))

    @property
    def report(self) -> ReadoutReport:
        """Counts and delays of the events so far."""
        fired, dropped, left, delayed = self._tally.counts.tolist()
        total_us, max_us = self._tally.delay_us.tolist()
        mean_us = total_us / left if left else 0.0
        return ReadoutReport(fired, dropped, delayed, mean_us * 1e-6, max_us * 1e-6)


class ReadOut:
    """The sent events: iterate over the parts once, then read `report`.

    Parameters are those of `read_out`.
    """

    def __init__(self, events: Iterable[Events], readout: Readout) -> None:
        self._source = events
        self._sender = Sender(readout)
        self._begun = self._ended = False
        self._parts = self._run()

    def __iter__(self) -> Iterator[Events]:
        """Yield parts in order, sorted by time, ties by (y, x)."""
        if self._ended:
            raise EventError(
                "ReadOut: the parts can be read only once, and have been read before; keep them in "
                "a list, or call read_out again"
            )
        return self._parts

    def _run(self) -> Iterator[Events]:
        self._begun = True
        try:
            for part in self._source:
                yield self._sender.push(part)
            if (last := self._sender.finish()) is not None:
                yield last
        finally:
            self._ended = True

    @property
    def report(self) -> ReadoutReport:
        """Counts and delays of the events so far."""
        if not self._begun:
            raise EventError(
                "ReadOut.report: no part has been read yet; read all of them first: "
                "`for events in parts: ...`, then `parts.report`"
            )
        return self._sender.report


def read_out(events: Events | Iterable[Events], readout: Readout) -> ReadOut:
    """Send events over a bus, which delays them, and drop events that find the FIFO full.

    The result does not depend on the division of the stream into parts.

    Parameters
    ----------
    events
        One stream, whole or in consecutive parts, as from `stream`. It is read while the result is
        iterated over.
    readout
        The bus.

    Returns
    -------
    ReadOut
        An iterable of the sent events, with the times at which they left. Memory depends only on
        the size of the parts and of the FIFO. `report` is complete after the iteration.

    Raises
    ------
    SensorError
        `readout` is not a bus.
    EventError
        During the iteration: the parts are not consecutive parts of one stream, or a time is out of
        range.

    Examples
    --------
    A hundred pixels of a row fire at once, and the FIFO has room for 60 events:

    >>> import numpy as np
    >>> from sensor import Events, Readout, read_out
    >>> x = np.arange(100, dtype=np.uint16)
    >>> burst = Events(np.full(100, 5), x, 0 * x, np.ones(100, np.int8), width=100, height=1)
    >>> sent = read_out(burst, Readout(max_rate_hz=1e6, fifo_depth=60))
    >>> sum(len(events) for events in sent)
    60
    >>> print(sent.report)
    100 events fired, 40 dropped (40 %), 60 delayed, by 30.5 us on average and 60 us at most
    """
    if not isinstance(readout, Readout):
        raise refusal("read_out: readout", readout, "a sensor.Readout")
    return ReadOut([events] if isinstance(events, Events) else events, readout)


class _Queue:
    """The FIFO and the bus of one sensor."""

    def __init__(self, readout: Readout, height: int) -> None:
        depth = readout.fifo_depth
        self._bus = fifo.Bus(readout.max_rate_hz / 1e6, readout.row_overhead_s * 1e6)
        state = np.zeros(fifo.STATE_SIZE, np.int64)
        state[fifo.BURST] = -1
        next_slot = np.arange(1, depth + 1, dtype=np.int64)  # a list of free slots
        next_slot[-1] = -1
        t_us, x, _, p = Columns.room(depth)
        row_first, row_last = np.full((2, height), -1)
        row_queue = np.empty(height, np.int64)
        self._fifo = fifo.Fifo(state, t_us, x, p, next_slot, row_first, row_last, row_queue)

    def take(self, part: Events, until_us: int, tally: fifo.Tally) -> Events:
        """Add the events of a part; return those sent until a time, its last event or later."""
        sent = self._room(len(part))
        used = fifo.accept(part.columns, self._bus, self._fifo, tally, sent)
        used = fifo.advance(until_us, self._bus, self._fifo, tally, sent, used)
        return Events.trusted(*sent.part(slice(used)), like=part)

    def drain(self, like: Events, tally: fifo.Tally) -> Events:
        """Send and return all waiting events."""
        sent = self._room(0)
        fifo.advance(fifo.END_OF_TIME_US, self._bus, self._fifo, tally, sent, 0)
        if late := int(self._fifo.state[fifo.WAITING]):
            raise EventError(
                f"readout: {late} events would leave after {fifo.END_OF_TIME_US} us; give "
                "earlier events, or a bus with a larger max_rate_hz or a smaller row_overhead_s"
            )
        return Events.trusted(*sent, like=like)

    def _room(self, more: int) -> Columns:
        """Allocate columns for all waiting events and `more`."""
        return Columns.room(int(self._fifo.state[fifo.WAITING]) + more)


def _in_order(events: Events) -> Events:
    fifo.order_ties(events.columns)
    return events
