"""The bus against closed-form cases, and against a slow model in exact fractions."""

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import COLUMNS
from sensor import EventError, Events, SensorError, SensorModel, simulate, stream
from sensor.events import concatenate
from sensor.readout import Readout, read_out


def make(t_us, x=None, y=None, p=None, size=(64, 64)):
    zero = np.zeros(len(t_us), int)
    x, y = (zero if c is None else np.asarray(c) for c in (x, y))
    return Events(
        np.asarray(t_us, np.int64),
        x.astype(np.uint16),
        y.astype(np.uint16),
        np.asarray(zero + 1 if p is None else p).astype(np.int8),
        *size,
    )


def through(events, **kwargs):
    """Return (events that leave, report)."""
    parts = read_out(events, Readout(**kwargs))
    return concatenate(list(parts)), parts.report


def test_the_parts_are_read_once_and_the_bus_is_a_readout():
    """Promise: a second iteration does not look like a stream without events."""
    events = make([1, 2], [0, 1], [0, 0])
    parts = read_out(events, Readout(max_rate_hz=1e6, fifo_depth=9))
    assert len(concatenate(list(parts))) == 2
    with pytest.raises(EventError, match="have been read before"):
        list(parts)
    with pytest.raises(
        SensorError, match=r"read_out: readout: found 1000000\.0, expected a sensor"
    ):
        read_out(events, 1e6)


def test_parts_that_failed_are_not_empty_the_second_time():
    """Promise: after an error the parts are gone, and say it."""
    bus = Readout(max_rate_hz=1e6, fifo_depth=1)
    sent = read_out([make([5, 9]), make([3, 4])], bus)
    with pytest.raises(EventError, match="begins at 3 us"):
        list(sent)
    with pytest.raises(EventError, match="have been read before"):
        list(sent)


def test_times_whose_differences_overflow_are_refused():
    """Promise: no event is said to leave after 2^62 us that leaves at once."""
    bus = Readout(max_rate_hz=1e6, fifo_depth=1)
    assert len(concatenate(list(read_out(make([1 - (1 << 62)]), bus)))) == 1
    for t_us in ([-5 * 10**18], [-4 * 10**18, 9 * 10**18]):
        with pytest.raises(EventError, match=r"an event at (-5|9)\d{18} us is out of range"):
            list(read_out(make(t_us), bus))


def test_below_capacity_there_is_only_service_time():
    """Physics: events farther apart than the service time do not wait: delay = overhead + 1 / R."""
    rng = np.random.default_rng(0)
    t_us = np.cumsum(rng.integers(4, 40, 1000))
    events = make(t_us, rng.integers(0, 64, 1000), rng.integers(0, 64, 1000))
    out, report = through(events, max_rate_hz=1e6, row_overhead_s=3e-6, fifo_depth=1)
    np.testing.assert_array_equal(out.t_us, t_us + 4)
    assert (report.dropped, report.delayed) == (0, 1000)
    assert report.mean_delay_s == pytest.approx(4e-6)
    assert report.max_delay_s == pytest.approx(4e-6)


def test_a_bus_with_plenty_to_spare_changes_nothing_but_the_last_microsecond():
    """Promise: a simulated stream over a bus of 1e12 events/s keeps every event and its time."""
    rng = np.random.default_rng(1)
    frames = np.exp(np.cumsum(rng.normal(0, 0.4, (12, 24, 24)), axis=0))
    model = SensorModel(width=24, height=24, cutoff_hz=200.0)
    events = simulate(frames, np.arange(12) * 1e-3, model)
    parts = read_out(
        stream(frames, np.arange(12) * 1e-3, model), Readout(max_rate_hz=1e12, fifo_depth=10**5)
    )
    out = concatenate(list(parts))
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(out, column), getattr(events, column))
    assert out.model == events.model
    assert parts.report.fired == len(events) > 1000
    assert (parts.report.dropped, parts.report.delayed) == (0, 0)


def test_overloaded_the_output_rate_is_the_capacity():
    """Physics: twice the capacity of the bus leaves at R, half is dropped, the delay is D / R."""
    t_us = np.repeat(np.arange(100_000), 2)
    events = make(t_us, np.tile([0, 1], 100_000))
    out, report = through(events, max_rate_hz=1e6, fifo_depth=500)
    assert len(out) == pytest.approx(100_000, abs=500)
    np.testing.assert_array_equal(np.diff(out.t_us), 1)
    assert report.dropped_share == pytest.approx(0.5, abs=500 / 200_000)
    assert report.max_delay_s == pytest.approx(500e-6, abs=2e-6)
    assert report.fired == len(out) + report.dropped == 200_000


@pytest.mark.parametrize("rate_hz", [0.25e6, 1e6, 12e6, 165e6])
def test_a_burst_empties_in_its_length_over_the_rate(rate_hz):
    """Physics: N simultaneous events leave at 1/R, 2/R ... N/R; the mean delay is (N + 1) / 2R."""
    n = 4096
    events = make(np.full(n, 777), np.tile(np.arange(64), 64), np.repeat(np.arange(64), 64))
    out, report = through(events, max_rate_hz=rate_hz, fifo_depth=n)
    leaves_us = np.arange(1, n + 1) / (rate_hz / 1e6)
    np.testing.assert_array_equal(out.t_us, 777 + np.floor(leaves_us + 0.5).astype(int))
    assert report.max_delay_s == pytest.approx(n / rate_hz, rel=1e-12)
    assert report.mean_delay_s == pytest.approx((n + 1) / 2 / rate_hz, rel=1e-12)


@pytest.mark.parametrize("depth", [1, 7, 100, 4095, 4096])
def test_a_fifo_drops_exactly_what_it_cannot_hold(depth):
    """Physics: of N simultaneous events a FIFO of D keeps D, the first by row and column."""
    n = 4096
    events = make(np.zeros(n), np.tile(np.arange(64), 64), np.repeat(np.arange(64), 64))
    out, report = through(events, max_rate_hz=1e6, fifo_depth=depth)
    assert report.dropped == n - depth
    for column in ("x", "y"):
        np.testing.assert_array_equal(getattr(out, column), getattr(events, column)[:depth])


def test_a_row_is_read_together_and_pays_once():
    """Physics: rows of n events have a rate of n / (overhead + n / R), for any number of rows."""
    rows, n = 50, 20
    y, x = np.repeat(np.arange(rows), n), np.tile(np.arange(n), rows)
    _, report = through(
        make(np.zeros(rows * n), x, y), max_rate_hz=10e6, row_overhead_s=0.5e-6, fifo_depth=1000
    )
    assert report.max_delay_s == pytest.approx(rows * (0.5e-6 + n / 10e6), rel=1e-12)


def test_the_row_that_waited_longest_is_next_and_latecomers_wait():
    """Promise: a granted row takes all waiting events; later events wait for its next turn."""
    # Row 5 is opened at once and pays 10 us. Row 2 fires at 3, row 5 again at 4, row 2 at 5.
    events = make([0, 3, 4, 5], [1, 2, 3, 4], [5, 2, 5, 2])
    out, report = through(events, max_rate_hz=1e6, row_overhead_s=10e-6, fifo_depth=9)
    assert out.t_us.tolist() == [11, 22, 23, 34]
    assert out.y.tolist() == [5, 2, 2, 5]
    assert out.x.tolist() == [1, 2, 4, 3]
    assert report.max_delay_s == pytest.approx(30e-6)


def slow_read_out(events, rate_hz, depth, overhead_s):
    """Model the same bus, event by event, in exact fractions of a microsecond."""
    each, overhead = 1 / (Fraction(rate_hz) / 10**6), Fraction(overhead_s) * 10**6
    waiting, burst, sent, dropped = [], [], [], 0
    free_at = Fraction(-1)

    def run(until):
        nonlocal burst, free_at, waiting
        while True:
            if burst:
                if burst[0][0] > until:
                    return
                sent.append(burst.pop(0))
            elif waiting and max(free_at, waiting[0][0]) < until:
                start, row = max(free_at, waiting[0][0]), waiting[0][2]
                together = [w for w in waiting if w[2] == row]
                waiting = [w for w in waiting if w[2] != row]
                burst = [(start + overhead + (k + 1) * each, *w) for k, w in enumerate(together)]
                free_at = burst[-1][0]
            else:
                return

    for t, x, y, p in zip(*(getattr(events, c).tolist() for c in COLUMNS), strict=True):
        run(t)
        if len(waiting) + len(burst) == depth:
            dropped += 1
        else:
            waiting.append((t, x, y, p))
    run(math.inf)
    delays = [leaves - t for leaves, t, *_ in sent]
    rows = [(math.floor(s[0] + Fraction(1, 2)), s[3], s[2], k, s[4]) for k, s in enumerate(sent)]
    return sorted(rows), dropped, delays


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    rate_hz=st.sampled_from([125_000, 500_000, 1_000_000, 8_000_000]),
    depth=st.sampled_from([1, 2, 5, 40, 1000]),
    overhead_s=st.sampled_from([0.0, 2.0**-19, 2.0**-16]),
    gap_us=st.sampled_from([0.3, 1.5, 6.0]),
    cuts=st.lists(st.integers(0, 400), max_size=6),
)
def test_every_event_is_where_the_slow_model_has_it(seed, rate_hz, depth, overhead_s, gap_us, cuts):
    """Promise: exact times, drops and delays at any load, for any division into parts."""
    rng = np.random.default_rng(seed)
    n = 400
    t_us = np.floor(np.cumsum(rng.exponential(gap_us, n))).astype(int)
    y, x = rng.integers(0, 4, n), rng.integers(0, 6, n)
    order = np.lexsort((x, y, t_us))
    events = make(t_us, x[order], y[order], rng.choice([-1, 1], n), size=(6, 4))
    whole, report = through(
        events, max_rate_hz=rate_hz, fifo_depth=depth, row_overhead_s=overhead_s
    )
    rows, dropped, delays = slow_read_out(events, rate_hz, depth, overhead_s)
    assert [r[0] for r in rows] == whole.t_us.tolist()
    assert [(r[1], r[2], r[4]) for r in rows] == list(
        zip(whole.y.tolist(), whole.x.tolist(), whole.p.tolist(), strict=True)
    )
    assert (report.fired, report.dropped) == (n, dropped)
    assert report.max_delay_s == pytest.approx(float(max(delays)) * 1e-6, rel=1e-12)
    assert report.mean_delay_s == pytest.approx(float(sum(delays) / len(delays)) * 1e-6, rel=1e-9)

    edges = [0, *sorted(cuts), n]
    parts = [events[a:b] for a, b in pairwise(edges)]
    cut, cut_report = through(
        iter(parts), max_rate_hz=rate_hz, fifo_depth=depth, row_overhead_s=overhead_s
    )
    for column in COLUMNS:
        np.testing.assert_array_equal(getattr(cut, column), getattr(whole, column))
    assert cut_report == report


def test_what_is_not_one_stream_is_refused():
    """Promise: errors name parts of a different size or out of order, and impossible buses."""
    first, second = make([5, 9]), make([3, 4])
    with pytest.raises(EventError, match=r"begins at 3 us, .* ends at 9 us"):
        list(read_out([first, second], Readout(max_rate_hz=1e6, fifo_depth=1)))
    with pytest.raises(EventError, match="32x32 px follows a part of 64x64"):
        list(read_out([first, make([10], size=(32, 32))], Readout(max_rate_hz=1e6, fifo_depth=1)))
    for kwargs, text in [
        ({"max_rate_hz": 0.0, "fifo_depth": 1}, "max_rate_hz"),
        ({"max_rate_hz": math.inf, "fifo_depth": 1}, "max_rate_hz"),
        ({"max_rate_hz": 1.0, "fifo_depth": 0}, "fifo_depth"),
        ({"max_rate_hz": 1.0, "fifo_depth": 1.5}, "fifo_depth"),
        ({"max_rate_hz": 1.0, "fifo_depth": 1, "row_overhead_s": -1.0}, "row_overhead_s"),
    ]:
        with pytest.raises(SensorError, match=text):
            Readout(**kwargs)


def test_a_bus_that_does_not_finish_is_an_error():
    """Promise: events that would leave after 2^62 us are not made up."""
    bus = Readout(max_rate_hz=1e-13, fifo_depth=4)
    with pytest.raises(EventError, match="3 events would leave after"):
        list(read_out([make([5, 6, 7])], bus))


def test_an_empty_stream_stays_empty():
    """Promise: without events, the bus emits none, drops none, and has no delay."""
    out, report = through(make([]), max_rate_hz=1e6, fifo_depth=4)
    assert len(out) == 0
    assert (report.fired, report.dropped_share, report.mean_delay_s) == (0, 0.0, 0.0)
