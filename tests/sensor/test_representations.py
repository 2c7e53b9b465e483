"""Voxel grids, counts and time surfaces, and tonic's structured arrays."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import assert_same, make_events, random_events, streams
from hashed_fill import hashed_events
from sensor import EventError, Events
from sensor.representations import event_counts, time_surface, voxel_grid


def slow_voxel_grid(events, bins, positions, convention):
    """Return the raw grid by the definition: each cell collects what falls within 1 of it."""
    grid = np.zeros((bins, events.height, events.width))
    duration_us = max(int(events.t_us[-1] - events.t_us[0]), 1)
    for k in range(len(events)):
        at = (bins - 1) * int(events.t_us[k] - events.t_us[0]) / duration_us
        x, y = positions[k]
        for b in range(max(math.floor(at), 0), min(math.floor(at) + 2, bins)):
            for row in range(max(math.floor(y), 0), min(math.floor(y) + 2, events.height)):
                for column in range(max(math.floor(x), 0), min(math.floor(x) + 2, events.width)):
                    weight = (1 - abs(at - b)) * (1 - abs(y - row)) * (1 - abs(x - column))
                    grid[b, row, column] += events.p[k] * weight
    return grid


@settings(max_examples=60)
@given(
    count=st.integers(1, 50),
    bins=st.integers(2, 20),
    mean_us=st.sampled_from([0.0, 0.3, 20.0, 1e6]),
    shift=st.floats(-30, 30),
    convention=st.sampled_from(["e2vid", "eraft"]),
    seed=st.integers(0, 1000),
)
def test_voxel_grid_equals_a_plain_loop(count, bins, mean_us, shift, convention, seed):
    """Definition: votes for the two bins around an event, and the four pixels around a position,
    those outside dropped; any window length, any number of bins, positions far outside, too."""
    events = random_events(count, 23, 17, start_us=seed, mean_us=mean_us, seed=seed)
    whole = np.stack([events.x, events.y], axis=1).astype(float)
    for positions, asked in ((whole, None), (whole + shift, whole + shift)):
        found = voxel_grid(events, bins, convention=convention, positions=asked, normalize=False)
        expected = slow_voxel_grid(events, bins, positions, convention)
        if convention == "eraft" and events.t_us[0] == events.t_us[-1]:
            expected[:] = 0
        np.testing.assert_allclose(found, expected, atol=1e-5 * count)


@pytest.mark.parametrize("positions", [np.float32, np.float64])
def test_votes_at_the_edge_stay_in_their_row(positions):
    """Promise: the last number below a width of a power of two has its votes in the last column."""
    x, y = np.nextafter(positions([4, 2]), positions(0))
    events = make_events([0, 1], [0, 0], [0, 0], [1, 1], 4, 2)
    at = np.array([[x, 0.0], [0.0, y]], positions)
    found = voxel_grid(events, 2, positions=at, normalize=False)
    np.testing.assert_allclose(found, 0.0, atol=1e-6)


# Computed with the networks' official code on these events: five entries at 0, 1/5, 1/3, just
# after 1/2 and at the end of the flattened grid.
E2VID_RAW = [0.006322791799902916, -0.5608067512512207, -0.05794556438922882, 0.06338789314031601,
             -0.7328424453735352]  # fmt: skip
E2VID = [0.002418878488242626, -0.6681860685348511, -0.07357552647590637, 0.06989575922489166,
         -0.8716105222702026]  # fmt: skip
ERAFT_RAW = [0.0, 0.0, -0.9297137260437012, 0.0, 0.0]
ERAFT = [0.0, 0.0, -1.3743462562561035, 0.0, 0.0]
RECTIFIED_RAW = [0.0, 0.0, -0.08211802691221237, 0.0, 0.20234031975269318]
RECTIFIED = [0.0, 0.0, -0.23972904682159424, 0.0, 0.6350207924842834]


@pytest.mark.parametrize(
    ("name", "count", "duration_us", "bins", "convention", "rectified", "raw", "normalized"),
    [
        ("stream", 5000, 50_000, 5, "e2vid", False, E2VID_RAW, E2VID),
        ("dsec", 6000, 100_000, 15, "eraft", False, ERAFT_RAW, ERAFT),
        ("dsecf", 6000, 100_000, 15, "eraft", True, RECTIFIED_RAW, RECTIFIED),
    ],
)
def test_voxel_grids_are_those_of_the_networks(
    name, count, duration_us, bins, convention, rectified, raw, normalized
):
    """Promise: grids equal those of the official code of E2VID and E-RAFT to 1e-5."""
    events, at = hashed_events(name, count, 40, 30, duration_us)
    for normalize, expected in ((False, raw), (True, normalized)):
        grid = voxel_grid(
            events,
            bins,
            convention=convention,
            positions=at if rectified else None,
            normalize=normalize,
        )
        n = grid.size
        places = [0, n // 5, n // 3, n // 2 + 7, n - 1]
        np.testing.assert_allclose(grid.reshape(-1)[places], expected, atol=1e-5)


@pytest.mark.parametrize("convention", ["e2vid", "eraft"])
def test_voxel_grids_of_none_and_of_one_event_are_finite(convention):
    """The networks' code divides by zero there; an empty grid stays 0, and one vote is centered."""
    none = make_events([], [], [], [], 4, 3)
    one = make_events([7], [1], [2], [1], 4, 3)
    for events in (none, one):
        assert not np.any(voxel_grid(events, 5, convention=convention))
    raw = voxel_grid(one, 5, convention=convention, normalize=False)
    assert raw.sum() == (1 if convention == "e2vid" else 0)


def test_a_convention_that_does_not_exist_is_refused():
    """Promise: a name that is written otherwise is not taken for another network's."""
    with pytest.raises(EventError, match="found convention='E-RAFT', expected 'e2vid' or 'eraft'"):
        voxel_grid(random_events(50), 3, convention="E-RAFT")


@given(count=st.integers(0, 60), mean_us=st.sampled_from([0.0, 9.0, 1e5]), seed=st.integers(0, 99))
def test_counts_and_time_surface_equal_a_plain_loop(count, mean_us, seed):
    """Definition: events per pixel and polarity, and the decay since the last of them."""
    events = random_events(count, 5, 3, mean_us=mean_us, seed=seed)
    tau_us, end_us = 1e4, int(events.t_us[-1]) + 5 if len(events) else 0
    counts = np.zeros((2, events.height, events.width), int)
    surface = np.zeros(counts.shape)
    for t_us, x, y, p in zip(*events.columns, strict=True):
        counts[int(p > 0), y, x] += 1
        surface[int(p > 0), y, x] = math.exp((int(t_us) - end_us) / tau_us)
    np.testing.assert_array_equal(event_counts(events), counts)
    np.testing.assert_array_equal(counts[1] - counts[0], events.polarity_sum())
    np.testing.assert_allclose(time_surface(events, tau_us, end_us), surface, rtol=1e-6, atol=1e-30)


def test_time_surface_refuses_a_time_before_the_last_event():
    """Promise: a window that reaches into the future is named, not clipped."""
    events = random_events(100)
    with pytest.raises(EventError, match=r"the event at \d+ us is after t_us = 3"):
        time_surface(events, 1e3, 3)
    with pytest.raises(EventError, match="tau_us = 0, expected a positive number"):
        time_surface(events, 0)


def test_time_surface_refuses_ages_beyond_64_bits():
    """Promise: a recency is in [0, 1] or an error."""
    pixel, p = np.array([0, 1], np.uint16), np.ones(2, np.int8)
    ends = np.array([-(1 << 62) - 10, (1 << 62) + 10])
    with pytest.raises(EventError, match=r"or 2\^63 us or more before"):
        time_surface(Events(ends, pixel, pixel, p, 8, 4), tau_us=1e3)
    with pytest.raises(EventError, match=r"or 2\^63 us or more before"):
        time_surface(Events(ends, pixel, pixel, p, 8, 4), tau_us=1e3, t_us=ends[-1])
    for t_us in (np.inf, np.nan, 1000.9):
        with pytest.raises(EventError, match="expected whole microseconds as an integer"):
            time_surface(Events(ends, pixel, pixel, p, 8, 4), tau_us=1e3, t_us=t_us)
    empty = Events(ends, pixel, pixel, p, 8, 4)[:0]
    assert not time_surface(empty, tau_us=1e3, t_us=1 << 70).any()


@settings(max_examples=30)
@given(streams())
def test_structured_arrays_keep_every_event(events):
    """Promise: tonic's dtype, there and back."""
    array = events.to_structured()
    assert array.dtype.descr == [("x", "<i2"), ("y", "<i2"), ("t", "<i8"), ("p", "|b1")]
    assert_same(Events.from_structured(array, events.width, events.height), events)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ([("x", "i2"), ("y", "i2"), ("t", "i8")], "expected x, y, t and p"),
        (
            [("x", "i2"), ("y", "i2"), ("t", "f8"), ("p", "?")],
            "found t of float64",
        ),
        (
            [("x", "i2"), ("y", "i2"), ("t", "i8"), ("p", "?")],
            "found x of int16 with values -1",
        ),
        (
            [("x", "f4"), ("y", "i2"), ("t", "i8"), ("p", "?")],
            "found x of float32",
        ),
    ],
)
def test_structured_arrays_are_checked(fields, text):
    """Promise: seconds, missing fields and negative pixels are refused by name."""
    array = np.zeros(1, fields)
    array["x"] = -1
    with pytest.raises(EventError, match=text):
        Events.from_structured(array, 4, 4)
