"""Damaged files: an error with the place, or valid events; no crash, hang or silent loss."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import COLUMNS, SUFFIXES, assert_same, random_events
from sensor import EventFormatError, Events, SensorModel
from sensor.formats import load_events, write_events

EVERY = pytest.mark.parametrize("name", list(SUFFIXES))
MODEL = SensorModel(width=640, height=480, cutoff_hz=200.0)
CHECKSUMMED = {"dsec", "npz"}
FUZZ = settings(max_examples=80, deadline=5000)  # ms: nothing hangs


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return every format's file of one stream: name -> (events, bytes)."""
    folder = tmp_path_factory.mktemp("whole")
    events = random_events(400, model=MODEL)
    files = {}
    for name in SUFFIXES:
        path = folder / f"{name}{SUFFIXES[name]}"
        write_events(path, events, format=name, origin={"seed": 3})
        files[name] = path.read_bytes()
    return events, files


def outcome(folder, name, data):
    """Return the events of a file with these bytes, after a check; None if the reader refuses
    it."""
    path = folder / f"damaged{SUFFIXES[name]}"
    path.write_bytes(data)
    try:
        found = load_events(path, format=name)
    except EventFormatError as error:
        said = str(error)
    else:
        return Events(*(getattr(found, c) for c in COLUMNS), found.width, found.height)
    assert said.startswith(f"{path}: ")
    return None


@EVERY
def test_cut_anywhere_is_an_error(name, whole, tmp_path):
    """Promise: the reader refuses a truncated file; text, which cannot detect it, gives whole
    lines."""
    events, files = whole
    data = files[name]
    for length in [*range(0, len(data), 29), len(data) - 2, len(data) - 1]:
        found = outcome(tmp_path, name, data[:length])
        if name != "text":
            assert found is None, f"{length} of {len(data)} bytes"
        elif found is not None:
            assert length >= data.index(b"\n") + 1
            assert_same(found, events[: len(found)])
            assert len(found) >= data[:length].count(b"\n") - 1


@pytest.mark.parametrize(
    ("text", "cut", "said"),
    [
        ("x,y,p,t\n12,40,1,1.5e-03\n31,21,0,1.75e-03\n", 2, "time"),
        ("t_us,p,x,y\n1500,1,12,40\n1750,0,31,217\n", 2, "pixel"),
        ("x,y,p,t\n12,40,1,1.5e-03\n31,21,0,1.75e-03\n", 0, ""),
        ("t,x,y,p\n1.5e-03,12,40,1\n1.75e-03,31,21,0\n", 1, ""),
    ],
)
def test_a_last_line_that_may_lack_digits_is_named(text, cut, said, tmp_path, caplog):
    """Promise: text that is truncated within its last number reads with a warning; polarities have
    one digit."""
    path = tmp_path / "a.csv"
    path.write_text(text[: len(text) - cut])
    found = load_events(path, size=(640, 480))
    assert len(found) == 2
    warned = [
        f"{path}: the last line has no line end; if the file is truncated, the last event has a "
    ]
    assert caplog.messages == [f"{one}wrong {said}" for one in warned if said]


@EVERY
@FUZZ
@given(
    flips=st.lists(st.tuples(st.integers(0, 1 << 20), st.integers(0, 7)), min_size=1, max_size=3)
)
def test_flipped_bits_give_an_error_or_valid_events(name, flips, whole, tmp_path):
    """Promise: with a flipped bit, the result is a valid stream of the full length.

    DSEC and npz have checksums, so there it is the same stream, or an error.
    """
    events, files = whole
    data = bytearray(files[name])
    for place, bit in flips:
        data[place % len(data)] ^= 1 << bit
    found = outcome(tmp_path, name, bytes(data))
    if found is None:
        return
    if name in CHECKSUMMED:
        assert_same(found, events)
    elif name.startswith("evt") and b"event_count" in data:
        assert len(found) == len(events)


@EVERY
@settings(FUZZ, max_examples=40)
@given(data=st.binary(max_size=400), keep=st.integers(0, 400))
def test_garbage_gives_an_error_or_valid_events(name, data, keep, whole, tmp_path):
    """Promise: random bytes, alone, after a valid start or after a whole file, give an error that
    names the file, or valid events."""
    _, files = whole
    outcome(tmp_path, name, data)
    outcome(tmp_path, name, files[name][:keep] + data)
    outcome(tmp_path, name, files[name] + data)


def test_events_that_a_format_cannot_hold_are_refused_with_the_file(tmp_path):
    """Promise: the error of a write names the file, and nothing is left there."""
    x = np.zeros(1, np.uint16)
    early = Events(np.array([-5]), x, x, np.ones(1, np.int8), 4, 4)
    with pytest.raises(EventFormatError, match=r"early\.raw: .*-5 us"):
        write_events(tmp_path / "early.raw", early)
    assert not [*tmp_path.iterdir()]
