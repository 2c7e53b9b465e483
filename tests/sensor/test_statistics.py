"""Statistics against histograms computed slowly, and against fields of known scaling."""

import math
from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensor import EventError, Events, SensorError, SensorModel, simulate
from sensor.statistics import (
    IntervalHistogram,
    event_rates_hz,
    fit_power_law,
    log_bin_edges_us,
    log_slope,
    mode_us,
    slopes_by_pixel_size,
)


def drawn_events(seed, n, width, height, span_us):
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(0, span_us, n))
    x = rng.integers(0, width, n).astype(np.uint16)
    y = rng.integers(0, height, n).astype(np.uint16)
    return Events(t_us, x, y, rng.choice([-1, 1], n).astype(np.int8), width, height)


def test_intervals_at_the_ends_of_int64():
    """Promise: any time that events may have counts; spans beyond 64 bits are refused."""
    pixel, p, window_us = np.zeros(2, np.uint16), np.ones(2, np.int8), (-(1 << 63), (1 << 63) - 1)
    for start_us in (-(1 << 62), -(1 << 62) - 10, (1 << 62) + 5):
        histogram = IntervalHistogram(1, 1, [1, 10, 100], window_us)
        times = np.array([start_us, start_us + 5])
        histogram.add(Events(times, pixel, pixel, p, 1, 1))
        assert histogram.counts.tolist() == [1, 0]
    histogram = IntervalHistogram(1, 1, [1, 10, 100], window_us)
    ends = np.array([-(1 << 62) - 10, (1 << 62) + 10])
    with pytest.raises(EventError, match=r"within less than 2\^63 us"):
        histogram.add(Events(ends, pixel, pixel, p, 1, 1))


@settings(max_examples=40)
@given(
    seed=st.integers(0, 1000),
    n=st.integers(0, 600),
    every_row=st.sampled_from([1, 2, 3]),
    cut=st.integers(0, 600),
)
def test_intervals_are_those_of_each_pixel(seed, n, every_row, cut):
    """Promise: per pixel, consecutive, ending in the window, in half-open bins, part by part."""
    events = drawn_events(seed, n, 5, 7, 20_000)
    edges = np.array([10, 100, 300, 1000, 4000])
    histogram = IntervalHistogram(5, 7, edges, (6_000, 15_000), every_row)
    histogram.add(events[:cut])
    histogram.add(events[cut:])

    times = defaultdict(list)
    for t, x, y in zip(events.t_us.tolist(), events.x, events.y, strict=True):
        if y % every_row == 0:
            times[x, y].append(t)
    found = [t1 - t0 for row in times.values() for t0, t1 in pairwise(row) if 6_000 <= t1 < 15_000]
    expected = np.histogram(np.array([f for f in found if f < 4000]), edges)[0]
    np.testing.assert_array_equal(histogram.counts, expected)
    assert histogram.shorter == sum(f < 10 for f in found)
    assert histogram.longer == sum(f >= 4000 for f in found)


def test_a_steady_ramp_has_one_interval():
    """Physics: log intensity that rises at s fires every C / s, Eq. (7); twice s halves it."""
    t_s = np.linspace(0, 0.2, 5)
    modes = []
    for s in (40.0, 80.0):
        frames = np.exp(s * t_s)[:, None, None] * np.ones((1, 4, 4))
        model = SensorModel(width=4, height=4, contrast_threshold=0.2, dark_level=0.0)
        histogram = IntervalHistogram(4, 4, log_bin_edges_us(), (0, 200_000))
        histogram.add(simulate(frames, t_s, model))
        assert np.count_nonzero(histogram.counts) == 1
        modes.append(mode_us(histogram.edges_us, histogram.counts))
    assert modes[0] == pytest.approx(0.2 / 40 * 1e6, rel=0.13)  # half a bin
    assert modes[1] == pytest.approx(0.2 / 80 * 1e6, rel=0.13)


def test_bins_are_even_in_log_time_and_the_mode_allows_for_rounded_edges():
    """Promise: 10 bins per decade, whole microseconds; a wide bin is not higher for its width."""
    edges = log_bin_edges_us()
    assert (edges[0], edges[-1], len(edges)) == (10, 100_000, 41)
    assert np.all(np.diff(np.log10(edges[10:])) == pytest.approx(0.1, abs=0.005))
    assert mode_us([10, 20, 80], [100, 150]) == pytest.approx(math.sqrt(200))
    assert mode_us([10, 20, 80], [0, 0]) is None
    for span_us in ((0, 1000), (0.1, 1), (100, 1), (10, 1e30), (10, np.nan)):
        with pytest.raises(EventError, match=r"expected increasing times from 1 to 1e\+18 us"):
            log_bin_edges_us(*span_us)
    for per_decade in (0, -1, np.nan):
        with pytest.raises(EventError, match=r"per_decade = .* at least one bin"):
            log_bin_edges_us(10, 1000, per_decade)


def test_windows_of_a_histogram_may_reach_beyond_any_event():
    """Promise: the same counts as in the largest window, in any order of calls; wrong arguments are
    named."""
    x = np.zeros(3, np.uint16)
    events = Events(np.array([0, 20, 50]), x, x, np.ones(3, np.int8), width=1, height=1)
    for window_us in ((0, 100), (0, 2**63), (-(2**70), 2**70)):
        histogram = IntervalHistogram(1, 1, [10, 25, 40], window_us)
        histogram.add(events)
        np.testing.assert_array_equal(histogram.counts, [1, 1])
    for arguments, said in (
        ((1, 1, [1, 2], (0,)), r"window_us=\(0,\), expected"),
        ((2.0, 1, [1, 2], (0, 1)), "width = 2.0, expected a positive integer"),
        ((1, -1, [1, 2], (0, 1)), "height = -1, expected a positive integer"),
    ):
        with pytest.raises(EventError, match=said):
            IntervalHistogram(*arguments)


@pytest.mark.parametrize(
    ("sizes", "blocks", "weights", "said"),
    [
        ([0, 3], [[2, 1], [2, 1]], None, "sizes: found"),
        ([3, 3], [[2, 1], [2, 1]], None, "sizes: found"),
        ([1, 3], [[np.inf, 1], [2, 1]], None, "blocks: found 2"),
        ([1, 3], [[2, 1], [2, 1]], [1, 1, 1], r"weights of shape \(3,\)"),
    ],
)
def test_what_has_no_power_law_is_refused(sizes, blocks, weights, said):
    """Promise: an error names the argument, in place of a law of NaN."""
    with pytest.raises(SensorError, match=said):
        fit_power_law(np.array(sizes), np.array(blocks, float), weights)


def test_hundreds_of_bins_do_not_wrap():
    """Promise: an interval is in its own bin, however many there are."""
    x = np.zeros(2, np.uint16)
    histogram = IntervalHistogram(1, 1, np.arange(1, 302), (0, 999))
    histogram.add(Events(np.array([0, 280]), x, x, np.ones(2, np.int8), 1, 1))
    assert np.flatnonzero(histogram.counts).tolist() == [279]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            {"edges_us": np.geomspace(1, 10, 12)},
            "edges_us: found .*float64, expected",
        ),
        (
            {"edges_us": [100, 50]},
            "edges_us: found .*100  *50.* of type int64, expected",
        ),
        (
            {"edges_us": [10, 1 << 28]},
            "edges_us: found .* from 0 to 2\\^28 - 1 us",
        ),
        ({"edges_us": [10]}, "edges_us: found \\[10\\] of type int64, expected"),
        ({"window_us": (0.0, 0.2)}, "found window_us = 0.0, expected whole microseconds"),
        ({"every_row": 0}, "found every_row = 0, expected a positive integer"),
    ],
)
def test_what_a_histogram_cannot_count_is_refused(options, said):
    """Promise: bins are never of another width than asked for, and seconds are no microseconds."""
    with pytest.raises(EventError, match=f"IntervalHistogram: {said}"):
        IntervalHistogram(4, 3, **{"edges_us": [1, 10], "window_us": (0, 100), **options})


def test_a_law_of_nothing_is_refused_and_blocks_at_rest_have_none():
    """Promise: no NaN: still light is an error, and one that moves in a corner has an interval."""
    sizes = np.array([1, 3, 9])
    with pytest.raises(SensorError, match=r"found means of \[0.0, 0.0, 0.0\], expected positive"):
        fit_power_law(sizes, np.zeros((8, 3)))
    blocks = np.zeros((8, 3))
    blocks[3] = sizes**-0.5
    law = fit_power_law(sizes, blocks)
    assert (law.exponent, law.low, law.high) == pytest.approx((0.5, 0.5, 0.5))


def test_events_of_another_sensor_are_refused():
    """Promise: a histogram never counts outside its pixels; a window has a length."""
    histogram = IntervalHistogram(7, 5, [10, 100], (0, 1000))
    events = drawn_events(3, 50, 5, 7, 1000)
    with pytest.raises(EventError, match="found events of 5x7 px, expected 7x5 px"):
        histogram.add(events)
    with pytest.raises(EventError, match="window from 9 to 9 us is empty"):
        event_rates_hz(events, 9, 9)


def test_rates_are_counts_over_the_window():
    """Promise: each pixel's events in the half-open window over its length."""
    events = drawn_events(3, 5000, 5, 7, 20_000)
    rates = event_rates_hz(events, 5_000, 15_000)
    slow = np.zeros((7, 5))
    for t, x, y in zip(events.t_us, events.x, events.y, strict=True):
        slow[y, x] += (5_000 <= t < 15_000) / 0.01
    np.testing.assert_allclose(rates, slow)
    ends_us = np.int32(-(2**31)), np.int32(2**31 - 1)  # their difference needs 33 bits
    long = event_rates_hz(events, *ends_us)
    np.testing.assert_allclose(long, event_rates_hz(events, *map(int, ends_us)))
    assert long.sum() == pytest.approx(5000 / 4294.967295)


def test_log_slope_is_the_derivative():
    """Physics: light that grows as e^{s t} on a dark level of 0 has L_t = s everywhere."""
    frame = np.random.default_rng(0).uniform(0.1, 5, (6, 8))
    np.testing.assert_allclose(log_slope(frame, frame * math.exp(30 * 2e-3), 2e-3, 0.0), 30)


def test_an_exact_power_law_is_found_exactly():
    """Promise: the fit returns the exponent and factor of p^-gamma, with an interval of width 0 if
    all blocks agree, and one that covers the exponent if they vary."""
    p = np.array([1.0, 2.0, 5.0, 10.0])
    blocks = np.outer([1.0, 3.0, 9.0], 7 * p**-0.8)
    law = fit_power_law(p, blocks, np.array([1, 1, 2]))
    assert law.exponent == pytest.approx(0.8)
    assert law.low == pytest.approx(0.8)
    assert law.high == pytest.approx(0.8)
    assert law.factor == pytest.approx(7 * (1 + 3 + 18) / 4)
    rng = np.random.default_rng(0)
    noisy = fit_power_law(p, 7 * p**-0.8 * np.exp(rng.normal(0, 0.3, (64, 4))))
    assert noisy.low < 0.8 < noisy.high
    assert noisy.high - noisy.low < 0.2
    with pytest.raises(ValueError, match="expected at least 2"):
        fit_power_law(p[:1], blocks[:, :1])


def moving_field(exponent, size=256, shift_px=0.05):
    """Return two frames, 1 ms apart, of a faint moving random field with spectrum f^-exponent."""
    rng = np.random.default_rng(1)
    fy, fx = np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None]
    radius = np.hypot(fx, fy)
    radius[0, 0] = np.inf
    spectrum = np.fft.fft2(rng.standard_normal((size, size))) * radius**-exponent
    frames = [np.fft.ifft2(spectrum * np.exp(2j * np.pi * fx * d)).real for d in (0, shift_px)]
    return [np.exp(0.05 * f / frames[0].std()) for f in frames]


def test_white_noise_and_smooth_light_scale_as_theory_says():
    """Physics: a moving square of white light gains and loses a column of p independent values, in
    a mean over p^2: |L_t| ~ sqrt(p) / p^2. Light that is smooth over the square keeps its slope."""
    white = slopes_by_pixel_size(*moving_field(0.0), 1e-3, 0.0, sizes_px=(7, 9, 13, 19))
    law = fit_power_law(white.sizes_px, white.everywhere)
    assert law.exponent == pytest.approx(1.5, abs=0.1)
    smooth = slopes_by_pixel_size(*moving_field(4.0), 1e-3, 0.0, sizes_px=(1, 3, 5))
    assert fit_power_law(smooth.sizes_px, smooth.everywhere).exponent == pytest.approx(0, abs=0.02)


def test_edges_are_the_steepest_pixels_and_blocks_weigh_what_they_hold():
    """Promise: the share of edges is correct, and the weighted mean over blocks is that over
    pixels."""
    first, second = moving_field(1.0)
    sizes = (1, 3)
    found = slopes_by_pixel_size(first, second, 1e-3, 0.1, sizes_px=sizes, blocks_a_side=8)
    inside = np.abs(log_slope(first, second, 1e-3, 0.1))[1:-1, 1:-1]
    edge = inside >= np.quantile(inside, 0.95)
    assert found.edge_weights.sum() == edge.sum()
    assert len(found.everywhere) == 64
    mean = np.average(found.edges[:, 0], weights=found.edge_weights)
    assert mean == pytest.approx(inside[edge].mean())
    with pytest.raises(ValueError, match="odd"):
        slopes_by_pixel_size(first, second, 1e-3, 0.1, sizes_px=(2,))
    with pytest.raises(ValueError, match="no room"):
        slopes_by_pixel_size(first[:20, :20], second[:20, :20], 1e-3, 0.1, sizes_px=(1, 19))


def test_parts_in_another_order_are_refused():
    """Promise: no interval is negative."""
    x = np.zeros(2, np.uint16)
    late, early = (
        Events(np.array(t_us), x, x, np.ones(2, np.int8), width=1, height=1)
        for t_us in ([500, 550], [100, 150])
    )
    histogram = IntervalHistogram(1, 1, [10, 100], (0, 1000))
    histogram.add(late)
    histogram.add(late[:0])
    with pytest.raises(EventError, match="from 100 to 150 us after events from 500 to 550 us"):
        histogram.add(early)
    assert histogram.counts.tolist() == [1]
