"""DSEC's layout, as DSEC's own readers use it."""

import math
import tracemalloc

import h5py
import hdf5plugin  # noqa: F401  (its filters)
import numpy as np
import pytest

from event_streams import assert_same, make_events, random_events
from sensor import EventFormatError, Events, SensorModel
from sensor.formats import batching as parts
from sensor.formats import load_events, read_header, write_events


class Slicer:
    """A window as DSEC's `EventSlicer` gets it: by milliseconds, then by microseconds."""

    def __init__(self, file):
        self.file = file
        self.ms_to_idx = np.asarray(file["ms_to_idx"], dtype="int64")
        self.t_offset = int(file["t_offset"][()])
        self.t_final = int(file["events/t"][-1]) + self.t_offset

    def window(self, t_start_us, t_end_us):
        start, end = t_start_us - self.t_offset, t_end_us - self.t_offset
        first_ms, last_ms = math.floor(start / 1000), math.ceil(end / 1000)
        assert first_ms >= 0
        if last_ms >= len(self.ms_to_idx):
            return None
        rough = slice(self.ms_to_idx[first_ms], self.ms_to_idx[last_ms])
        t = np.asarray(self.file["events/t"][rough])
        inside = slice(*(rough.start + np.searchsorted(t, (start, end))))
        columns = {name: np.asarray(self.file[f"events/{name}"][inside]) for name in "xyp"}
        return {"t": self.file["events/t"][inside] + self.t_offset} | columns


@pytest.mark.parametrize("start_us", [0, 7_654_321, 54_321_987_654, -3_500])
def test_dsecs_slicer_gets_every_window(start_us, tmp_path, monkeypatch):
    """Promise: windows by ms_to_idx equal those of `between`, wherever the clock starts."""
    monkeypatch.setattr(parts, "PART_EVENTS", 777)
    events = random_events(5000, start_us=start_us, mean_us=12)
    write_events(tmp_path / "a.h5", events)
    rng = np.random.default_rng(0)
    with h5py.File(tmp_path / "a.h5") as file:
        slicer = Slicer(file)
        assert slicer.t_final == events.t_us[-1]
        for _ in range(50):
            a, b = np.sort(rng.integers(events.t_us[0], events.t_us[-1] - 1000, 2))
            window, expected = slicer.window(int(a), int(b) + 1), events.between(a, b + 1)
            np.testing.assert_array_equal(window["t"], expected.t_us)
            np.testing.assert_array_equal(window["x"], expected.x)
            np.testing.assert_array_equal(window["y"], expected.y)
            np.testing.assert_array_equal(window["p"], expected.p > 0)


@pytest.mark.parametrize("batch", [2, 3, 100])
def test_ms_to_idx_of_dsecs_example(batch, tmp_path, monkeypatch):
    """Format: the example in DSEC's own source, for any division of the stream."""
    monkeypatch.setattr(parts, "PART_EVENTS", batch)
    t_us = [0, 500, 2100, 5000, 5000, 7100, 7200, 7200, 8100, 9000]
    zeros = [0] * len(t_us)
    write_events(tmp_path / "a.h5", make_events(t_us, zeros, zeros, zeros))
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["ms_to_idx"][:].tolist() == [0, 2, 2, 3, 3, 3, 5, 5, 8, 9]


def test_a_long_pause_needs_no_memory(tmp_path):
    """Promise: the index of the milliseconds of a pause of three hours is written in parts."""
    events = make_events([1 << 50, (1 << 50) + 10**10], [0, 1], [0, 0], [1, 0])
    tracemalloc.start()
    write_events(tmp_path / "a.h5", events)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6  # the index has 80 MB
    assert_same(load_events(tmp_path / "a.h5"), events)
    with h5py.File(tmp_path / "a.h5") as file:
        index = file["ms_to_idx"]
        assert (len(index), index[0], index[1], index[-1]) == (10**7 + 1, 0, 1, 1)


def test_ms_to_idx_by_its_definition(tmp_path):
    """Format: t[idx[ms]] >= 1000 ms and t[idx[ms] - 1] < 1000 ms for every whole millisecond."""
    events = random_events(3000, start_us=5_400, mean_us=40)
    write_events(tmp_path / "a.h5", events)
    with h5py.File(tmp_path / "a.h5") as file:
        t, idx = file["events/t"][:].astype(np.int64), file["ms_to_idx"][:].astype(np.int64)
    ms = np.arange(len(idx))
    assert len(idx) == t[-1] // 1000 + 1
    assert np.all(t[idx] >= 1000 * ms)
    assert np.all(t[idx[idx > 0] - 1] < 1000 * ms[idx > 0])


def test_a_span_beyond_64_bits_is_refused(tmp_path):
    """Promise: a stream that a file cannot hold leaves none."""
    pixel, p = np.zeros(2, np.uint16), np.ones(2, np.int8)
    ends = np.array([-(1 << 62) + 2000, (1 << 63) - 1])
    with pytest.raises(EventFormatError, match=r"DSEC: events last until \d+ us after t_offset"):
        write_events(tmp_path / "a.h5", Events(ends, pixel, pixel, p, 8, 4))
    assert list(tmp_path.iterdir()) == []


def test_layout(tmp_path):
    """Format: DSEC's names and dtypes, p as 0 and 1, zstd at level 1, and the origin."""
    model = SensorModel(width=640, height=480, cutoff_hz=200.0, dark_level=1e-3)
    events = random_events(2000, model=model)
    write_events(tmp_path / "a.h5", events, origin={"seed": 5})
    with h5py.File(tmp_path / "a.h5") as file:
        dtypes = {f"events/{name}": file[f"events/{name}"].dtype for name in "txyp"}
        assert dtypes == {
            "events/t": np.uint32,
            "events/x": np.uint16,
            "events/y": np.uint16,
            "events/p": np.uint8,
        }
        assert (file["t_offset"].shape, file["t_offset"][()]) == ((), 0)
        assert file["t_offset"].dtype == np.int64
        assert set(np.unique(file["events/p"])) == {0, 1}
        filters = file["events/t"].id.get_create_plist()
        zstd = [filters.get_filter(k) for k in range(filters.get_nfilters())]
        assert [f[2] for f in zstd if f[0] == 32015] == [(1,)]
        assert (file.attrs["width"], file.attrs["height"]) == (640, 480)
        assert file.attrs["origin"] == b'{"seed": 5}'
        assert b'"cutoff_hz": 200.0' in file.attrs["sensor_model"]
    header = read_header(tmp_path / "a.h5")
    assert (header.model, header.origin) == (model, {"seed": 5})


def test_clocks(tmp_path):
    """Promise: times count from 0 with t_offset 0, unless 32 bits would soon overflow.

    Then they have 64 bits, and DSEC's `t + t_offset` does not overflow.
    """
    for start_us, offset_us in [(0, 0), (2_000_000_000, 0), (1 << 31, 2147483000), (-1, -1000)]:
        write_events(tmp_path / "a.h5", make_events([start_us], [0], [0], [1]))
        with h5py.File(tmp_path / "a.h5") as file:
            assert file["t_offset"][()] == offset_us
            assert file["events/t"].dtype == (np.int64 if offset_us else np.uint32)
        assert load_events(tmp_path / "a.h5").t_us.tolist() == [start_us]


@pytest.mark.parametrize("start_us", [1 << 62, -(1 << 62)])
def test_a_start_that_could_not_be_read_is_not_written(start_us, tmp_path):
    """Promise: what a file cannot store is refused, and no file appears."""
    for events in (make_events([start_us], [0], [0], [1]), make_events([], [], [], [], 4, 4)):
        with pytest.raises(EventFormatError, match=rf"DSEC: .* {start_us} us"):
            write_events(tmp_path / "a.h5", events, t_offset_us=start_us)
    assert not list(tmp_path.iterdir())


def dsec_file(path, **changed):
    """Write a file like DSEC's: no attributes, a clock offset, and some columns in other ways."""
    columns = {
        "t": np.array([5, 9, 9], np.uint32),
        "x": np.array([1, 2, 639], np.uint16),
        "y": np.array([1, 2, 479], np.uint16),
        "p": np.array([0, 1, 1], np.uint8),
    }
    with h5py.File(path, "w") as file:
        for name, column in (columns | changed).items():
            if column is not None:
                file[f"events/{name}"] = column
        file["t_offset"] = np.int64(1000)
    return path


def test_dsecs_own_recordings(tmp_path):
    """Promise: files without our attributes need only a size; the reader adds t_offset."""
    path = dsec_file(tmp_path / "a.h5")
    with pytest.raises(EventFormatError, match="does not store the sensor's size"):
        load_events(path)
    expected = make_events([1005, 1009, 1009], [1, 2, 639], [1, 2, 479], [0, 1, 1])
    assert_same(load_events(path, size=(640, 480)), expected)
    wide = dsec_file(tmp_path / "b.h5", t=np.array([5.0, 9.0, 9.0]).astype(np.int64), p=[False] * 3)
    assert load_events(wide, size=(640, 480)).p.tolist() == [-1, -1, -1]


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"t": None}, "events/t: missing"),
        ({"t": np.array([5.0, 9.0, 9.0])}, "events/t: found"),
        ({"x": np.zeros((3, 1), int)}, "events/x: found"),
        ({"y": [1, 2]}, "events/y: has 2 entries"),
        ({"p": [0, 1, 2]}, "events/p, entry 2: found 2, expected 0 to 1"),
        ({"p": [-1, 1, 1]}, "events/p, entry 0: found -1, expected 0 to 1"),
        ({"x": [1, 640, 2]}, "events/x, entry 1: found 640, expected 0 to 639"),
        ({"y": [480, 1, 2]}, "events/y, entry 0: found 480, expected 0 to 479"),
        ({"t": [5, 4, 9]}, "event 1 is earlier"),
        (
            {"t": np.array([5, 6, 1 << 63], np.uint64)},
            "events/t, entry 2: found 9223372036854775808",
        ),
    ],
)
def test_files_that_are_not_events_are_refused(changed, said, tmp_path):
    """Promise: the error names the wrong object and its value."""
    path = dsec_file(tmp_path / "a.h5", **changed)
    with pytest.raises(EventFormatError) as error:
        load_events(path, size=(640, 480))
    assert said in str(error.value)


def test_fractions_are_refused(tmp_path):
    """Promise: a clock in seconds or a broken size is not cut off in silence."""
    path = dsec_file(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["width"] = 640.5
    with pytest.raises(EventFormatError, match=r"width: found 640.5, expected a whole number"):
        read_header(path)
    with h5py.File(path, "r+") as file:
        file.attrs["width"] = 640.0
        del file["t_offset"]
        file["t_offset"] = 1.7
    with pytest.raises(EventFormatError, match=r"t_offset: found 1.7, expected a whole number"):
        read_header(path)
