"""Promises of every event format: all events come back, in bounded memory, or a clear error."""

import itertools
import time
import tracemalloc
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from decimal import ROUND_HALF_UP, Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import SUFFIXES, assert_same, make_events, random_events, streams
from sensor import EventError, EventFormatError, SensorModel, simulate, stream
from sensor.events import concatenate
from sensor.formats import (
    batching as parts,
)
from sensor.formats import (
    evt,
    find_format,
    load_events,
    read_events,
    read_header,
    text,
    write_events,
)

EVERY = pytest.mark.parametrize("name", list(SUFFIXES))


def file_of(folder, name):
    return folder / f"events{SUFFIXES[name]}"


def in_parts(events, cuts):
    edges = [0, *sorted(c % (len(events) + 1) for c in cuts), len(events)]
    return [events[a:b] for a, b in itertools.pairwise(edges)]


@EVERY
@settings(max_examples=30)
@given(events=streams(), cuts=st.lists(st.integers(0, 40), max_size=3))
def test_every_event_comes_back(name, events, cuts, tmp_path):
    """Promise: for any parts of writing and of reading, columns, size and model are the same."""
    path = file_of(tmp_path, name)
    assert write_events(path, in_parts(events, cuts), format=name) == len(events)
    back = load_events(path, format=name)
    assert_same(back, events)
    header = read_header(path, format=name)
    assert (header.width, header.height) == (events.width, events.height)
    if name != "text":  # which does not store it
        assert back.model == events.model == header.model


@EVERY
def test_files_depend_on_the_events_not_on_how_they_were_cut(name, tmp_path, monkeypatch):
    """Promise: the same stream in different parts gives the same bytes; many parts read as one."""
    monkeypatch.setattr(parts, "PART_EVENTS", 1000)
    events = random_events(4321)
    files = []
    for k, cuts in enumerate([[], [1, 2, 3000], range(0, 4321, 7)]):
        if name == "dsec" and k == 2:
            time.sleep(1.01 - time.time() % 1)  # HDF5 can note times, in seconds
        files.append(tmp_path / f"{k}{SUFFIXES[name]}")
        write_events(files[-1], in_parts(events, cuts), format=name, origin={"seed": 3})
    assert len({file.read_bytes() for file in files}) == 1
    read = list(read_events(files[0], format=name))
    assert len(read) > 4
    assert max(map(len, read)) <= 1000
    assert_same(load_events(files[0], format=name), events)


@EVERY
def test_memory_does_not_grow_with_the_stream(name, tmp_path, monkeypatch):
    """Promise: three times as many events need no more memory to write or read."""
    monkeypatch.setattr(parts, "PART_EVENTS", 1 << 12)
    monkeypatch.setattr(evt, "_READ_WORDS", 1 << 12)
    monkeypatch.setattr(text, "_READ_BYTES", 1 << 14)
    chunk = random_events(1 << 12)

    def many(count):
        step_us = int(chunk.t_us[-1]) + 1
        for k in range(count):
            later = chunk.t_us + k * step_us
            yield replace(chunk, t_us=later)

    def peak(count):
        path = file_of(tmp_path, name)
        tracemalloc.start()
        write_events(path, many(count), format=name)
        got = sum(len(part) for part in read_events(path, format=name))
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert got == count * len(chunk)
        return used

    peak(1)  # imports and compilation
    few, many_more = peak(20), peak(60)
    assert many_more < few + (1 << 19)  # the longer stream has 2 MB more of arrays


@EVERY
def test_simulated_streams_go_straight_to_files(name, tmp_path):
    """Promise: `stream` into a file and back equals `simulate`, with its model."""
    y, x = np.mgrid[:24, :32]
    t_s = np.arange(60) * 1e-3
    frames = np.exp(np.sin(x / 3 + y / 5 + 90 * t_s[:, None, None]))
    model = SensorModel(width=32, height=24, cutoff_hz=200.0)
    path = file_of(tmp_path, name)
    count = write_events(path, stream(frames, t_s, model), format=name, origin={"seed": 0})
    expected = simulate(frames, t_s, model)
    assert count == len(expected) > 1000
    back = load_events(path, format=name)
    assert_same(back, expected)
    if name != "text":
        assert back.model == expected.model
        assert read_header(path, format=name).origin == {"seed": 0}


@EVERY
def test_empty_streams_are_files_too(name, tmp_path):
    """Promise: a stream without events keeps its size and reads as one empty part."""
    path = file_of(tmp_path, name)
    empty = make_events([], [], [], [], 33, 21)
    assert write_events(path, [empty, empty], format=name) == 0
    assert_same(load_events(path, format=name), empty)


@EVERY
def test_origin_says_how_it_was_made(name, tmp_path):
    """Promise: files store seed, speed and sequence with the model, in any language."""
    origin = {"seed": 7, "speed": 4 / 3, "scene": 'carpet, "größer" \u2192 %', "clip": 0}
    path = file_of(tmp_path, name)
    write_events(path, random_events(10), format=name, origin=origin)
    assert read_header(path, format=name).origin == ({} if name == "text" else origin)


@EVERY
def test_a_file_appears_whole_or_not_at_all(name, tmp_path):
    """Promise: a stream that fails does not change the old file and leaves no other file."""
    path = file_of(tmp_path, name)
    write_events(path, random_events(5), format=name)
    before = path.read_bytes()

    def failing():
        yield random_events(100)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_events(path, failing(), format=name)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


def too_wide():
    return make_events([0], [2048], [0], [1], 2049, 10)


LATE, EARLY = (make_events([t], [0], [0], [1]) for t in (1 << 40, -1))
CANNOT = {
    "evt2 x": ("evt2", [too_wide()], "the sensor has 2049x10 px"),
    "evt3 x": ("evt3", [too_wide()], "the sensor has 2049x10 px"),
    "evt2 late": ("evt2", [LATE], "to 1099511627776 us, expected 0 to 1099511627775"),
    "evt3 late": ("evt3", [LATE], "to 1099511627776 us, expected 0 to 1099511627775"),
    "evt2 early": ("evt2", [EARLY], "found times from -1 to"),
    "evt3 early": ("evt3", [EARLY], "found times from -1 to"),
    "dsec span": ("dsec", [make_events([5, 1 << 32], [0, 0], [0, 0], [1, 1])], "4294967296 us"),
    "dsec index": (
        "dsec",
        [make_events([1 << 50, (1 << 50) + (1 << 38)], [0, 0], [0, 0], [1, 1])],
        "the limit is 274877906944 us",
    ),
    "text": ("text", [make_events([(1 << 63) - 1], [0], [0], [1])], "9000000000000 s"),
    "none": ("npz", [], "found none, expected at least one"),
    "order": ("npz", [LATE, EARLY], "part 1: starts at -1 us"),
    "sensor": (
        "npz",
        [EARLY, random_events(1, width=320)],
        "part 1: its size, 320x480 px",
    ),
    "kind": ("npz", [np.zeros(3)], "part 0: found ndarray, expected Events"),
}


def test_parts_of_larger_arrays_do_not_keep_them():
    """Promise: a few parts are in memory at a time, also if they are slices."""
    whole = [random_events(10_000) for _ in range(5)]
    arrays = [weakref.ref(one.x) for one in whole]
    kept = []

    def slices():
        for k in range(len(arrays)):
            yield whole.pop(0)[:10].later(10**6 * k)
        kept.extend(array for array in arrays[:-1] if array() is not None)

    (found,) = parts.rebatch(slices())
    assert len(found) == 50
    assert kept == []


@pytest.mark.parametrize("case", CANNOT)
def test_what_a_format_cannot_hold_is_refused(case, tmp_path):
    """Promise: a format never changes an event to fit; the error names the value, and no file is
    left."""
    name, stream_parts, said = CANNOT[case]
    with pytest.raises(EventFormatError) as error:
        write_events(file_of(tmp_path, name), stream_parts, format=name)
    assert said in str(error.value)
    assert not list(tmp_path.iterdir())
    assert isinstance(error.value, EventError)


@pytest.mark.parametrize("origin", [{"Seed": 1}, {"a b": 1}, {"x": None}, {"x": float("nan")}])
def test_origins_that_no_file_could_say_are_refused(origin, tmp_path):
    """Promise: entries of an origin are named values, or cause an error."""
    with pytest.raises(EventFormatError, match="origin"):
        write_events(tmp_path / "a.npz", random_events(1), origin=origin)


def test_the_extension_chooses_the_format(tmp_path):
    """Promise: .h5 .hdf5 .raw .npz .txt in any case; the header of an existing .raw has its
    version."""
    for suffix, name in [("h5", "dsec"), ("HDF5", "dsec"), ("npz", "npz"), ("txt", "text")]:
        assert find_format(f"a.{suffix}").name == name
    path = tmp_path / "a.raw"
    assert find_format(path).name == "evt3"
    write_events(path, random_events(9), format="evt2")
    assert find_format(path).name == "evt2"
    assert len(load_events(path)) == 9
    write_events(path, random_events(9))
    assert find_format(path).name == "evt3"
    with pytest.raises(EventFormatError, match=r"version evt3, but the file is read as EVT2"):
        load_events(path, format="evt2")
    with pytest.raises(EventFormatError, match=r"extension '.dat4', expected one of .h5"):
        write_events(tmp_path / "a.dat4", random_events(9))
    with pytest.raises(EventFormatError, match=r"a.dat: Prophesee DAT can only be read"):
        write_events(tmp_path / "a.dat", random_events(9))
    with pytest.raises(EventFormatError, match="'evt4', expected one of dsec, evt3"):
        load_events(path, format="evt4")


def test_sizes_are_stored_or_given_and_never_guessed(tmp_path):
    """Promise: a file without a size needs one, and a size that contradicts the file is an
    error."""
    bare = tmp_path / "bare.txt"
    bare.write_text("0.5 3 4 1\n1.25 5 6 0\n")
    with pytest.raises(EventFormatError, match="does not store the sensor's size"):
        load_events(bare)
    given = load_events(bare, size=(346, 260))
    assert_same(given, make_events([500_000, 1_250_000], [3, 5], [4, 6], [1, 0], 346, 260))
    sized = tmp_path / "sized.npz"
    write_events(sized, given)
    assert_same(load_events(sized, size=(346, 260)), given)
    with pytest.raises(EventFormatError, match=r"size: .*346x260.*640x480"):
        load_events(sized, size=(640, 480))


def test_missing_files_and_folders_are_the_systems_errors(tmp_path):
    """Promise: the error names the missing file or folder before any writing."""
    for suffix in SUFFIXES.values():
        with pytest.raises(FileNotFoundError) as error:
            read_events(tmp_path / f"none{suffix}")
        assert error.value.filename == str(tmp_path / f"none{suffix}")
        with pytest.raises(FileNotFoundError) as error:
            write_events(tmp_path / "no" / f"a{suffix}", random_events(1))
        assert error.value.filename == str(tmp_path / "no")


@pytest.mark.parametrize("error", [OSError("camera is gone"), TimeoutError("no answer")], ids=str)
def test_an_error_of_the_source_is_the_source_s(error, tmp_path, monkeypatch):
    """Promise: it arrives as it was raised, however late, and is not said to be of the new file."""
    monkeypatch.setattr(parts, "PART_EVENTS", 1000)
    large = random_events(1001)

    def source():
        yield large
        raise error

    with pytest.raises(OSError, match=f"^{error}$") as raised:
        write_events(tmp_path / "a.raw", source())
    assert raised.value is error
    assert list(tmp_path.iterdir()) == []


@EVERY
def test_names_may_be_as_long_as_the_system_allows(name, tmp_path):
    """Promise: the temporary name is short; a name that is too long is named by the error."""
    events = make_events([0], [1], [2], [1])
    write_events(tmp_path / ("記" * 80 + ".x"), events, format=name)
    with pytest.raises(OSError, match=f"too long.*{'記' * 90}"):
        write_events(tmp_path / ("記" * 90), events, format=name)


def test_numpy_reads_npz(tmp_path):
    """Promise: `numpy.load` reads an npz file; the reader also reads one that numpy compressed."""
    events = random_events(50)
    write_events(tmp_path / "a.npz", events, origin={"seed": 1})
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_array_equal(arrays["t_us"], events.t_us)
        np.testing.assert_array_equal(arrays["p"], events.p)
        assert (int(arrays["width"]), str(arrays["origin"])) == (640, '{"seed": 1}')
    columns = {name: getattr(events, name) for name in ("t_us", "x", "y", "p")}
    np.savez_compressed(tmp_path / "b.npz", **columns)
    assert_same(load_events(tmp_path / "b.npz", size=(640, 480)), events)


def test_text_is_seconds_and_zero_or_one(tmp_path):
    """Promise: text is `t x y p`; the reader accepts other files' decimals, blanks and line
    ends."""
    t_us = [-1_500_000, 0, 7, 123_456_789]
    events = make_events(t_us, [0, 1, 2, 639], [0, 0, 9, 479], [0, 1, 0, 1])
    path = tmp_path / "a.txt"
    write_events(path, events)
    assert path.read_text() == (
        "640 480\n-1.500000 0 0 0\n0.000000 1 0 1\n0.000007 2 9 0\n123.456789 639 479 1\n"
    )
    path.write_bytes(b"0.003811000 96 133 0\r\n 1\t2  3 1\n\n2.0000006 0 0 1 \n2.0000015 0 0 1")
    read = load_events(path, size=(240, 180))
    assert read.t_us.tolist() == [3811, 1_000_000, 2_000_001, 2_000_002]
    assert read.x.tolist() == [96, 2, 0, 0]


def test_times_of_savetxt_are_rounded_to_the_nearest_microsecond(tmp_path):
    """Promise: numpy's 19 digits too, below a microsecond, where all of them are decimals."""
    t_s = [0.0, 4.9e-7, 5.1e-7, 7.47e-7, 9.3e-7, 1.49e-6, 1.51e-6, 9.49e-5]
    np.savetxt(tmp_path / "a.txt", [(t, 1, 2, 1) for t in t_s])
    found = load_events(tmp_path / "a.txt", size=(9, 9))
    assert found.t_us.tolist() == [0, 0, 1, 1, 1, 1, 2, 95]


@pytest.mark.parametrize("suffix", [".npz", ".raw", ".h5"])
def test_an_origin_that_could_not_be_read_is_not_written(suffix, tmp_path):
    """Promise: a header is not longer than readers accept, and no file appears; the longest can
    be read."""
    path = tmp_path / f"a{suffix}"
    with pytest.raises(EventFormatError, match="origin: found 300012 characters of JSON"):
        write_events(path, random_events(3), origin={"note": "x" * 300_000})
    assert not list(tmp_path.iterdir())
    longest = {"note": "x" * 199_988}
    write_events(path, random_events(3), origin=longest)
    assert read_header(path).origin == longest


SAME = make_events([1500, 2_000_000], [3, 5], [4, 6], [0, 1], 346, 260)
OTHERS = {
    "blanks": "346 260\n0.0015 3 4 0\n2.0 5 6 1\n",
    "-1 and 1": "0.0015 3 4 -1\n2.0 5 6 +1\n",
    "commas": "0.0015,3,4,0\n2.0, 5 ,6,1\r\n",
    "tabs": "0.0015\t3\t4\t0\n2.0\t5\t6\t1",
    "exponents": "1.5e-3 3 4 0\n+2E0 5 6 1\n",
    "numpy.savetxt": "# made by hand\n1.500000000000000000e-03 3.0e+00 4.0e+00 0.0e+00\n"
    "2.000000000000000000e+00 5.000000000000000000e+00 60e-1 1.000000000000000000e+00\n",
    "comments": "# a camera\n% of mine\n346 260\n0.0015 3 4 0\n2.0 5 6 1\n",
    "a byte order mark": "\ufeff346 260\n0.0015 3 4 0\n2.0 5 6 1\n",
    "a byte order mark before events": "\ufeff0.0015 3 4 0\n2.0 5 6 1\n",
    "a long comment": f"#{' ' * 60_000}\n0.0015 3 4 0\n2.0 5 6 1\n",
    "names": "t,x,y,p\n0.0015,3,4,0\n2.0,5,6,1\n",
    "names with a unit": "x,y,Polarity,timestamp_us\n3,4,0,1500\n5,6,1,2000000\n",
    "names in a comment": "# p time [ns] x y\n-1 1500000 3 4\n1 2000000000 5 6\n",
    "quoted names": '"t (ms)","x","y","on"\n1.5,3,4,0\n2000,5,6,1\n',
}


@pytest.mark.parametrize("suffix", ["txt", "csv"])
@pytest.mark.parametrize("kind", OTHERS)
def test_text_of_others(kind, suffix, tmp_path):
    """Promise: the reader takes other separators, signs, exponents, comments and orders."""
    path = tmp_path / f"a.{suffix}"
    path.write_text(OTHERS[kind], "utf-8", newline="")
    assert_same(load_events(path, size=(346, 260)), SAME)


@pytest.mark.parametrize(("unit", "scale"), [("s", 6), ("ms", 3), ("us", 0), ("ns", -3)])
def test_the_unit_of_times_is_given_or_in_the_file(unit, scale, tmp_path):
    """Promise: whole times need a unit, given or by name, and the two agree."""
    path = tmp_path / "a.txt"
    path.write_text("7000 1 2 1\n1234567 1 2 1\n")
    with pytest.raises(EventFormatError, match="times, 7000, 1234567"):
        load_events(path, size=(9, 9))
    expected = [round(t * 10.0**scale) for t in (7000, 1234567)]
    assert load_events(path, size=(9, 9), time_unit=unit).t_us.tolist() == expected
    path.write_text(f"t_{unit} x y p\n" + path.read_text())
    assert load_events(path, size=(9, 9)).t_us.tolist() == expected
    other = {"s": "us"}.get(unit, "s")
    with pytest.raises(EventFormatError, match=f"says {unit}, not the given {other}"):
        load_events(path, size=(9, 9), time_unit=other)
    with pytest.raises(EventFormatError, match="time_unit: found 'min', expected one of s, ms"):
        load_events(path, size=(9, 9), time_unit="min")
    write_events(tmp_path / "a.npz", SAME)
    with pytest.raises(EventFormatError, match=r"time_unit: found 's', but numpy"):
        load_events(tmp_path / "a.npz", time_unit="s")


@settings(max_examples=60)
@given(
    digits=st.integers(0, 10**18 - 1),
    exponent=st.integers(-30, 12),
    unit=st.sampled_from(["s", "ms", "us", "ns"]),
    point=st.integers(0, 25),
)
def test_times_are_rounded_as_decimals(digits, exponent, unit, point, tmp_path):
    """Promise: any decimal with any exponent is the nearest microsecond, ties away from zero."""
    written = f"{digits:025d}"
    written = f"-{written[:point]}.{written[point:]}e{exponent}"
    factor = Decimal(10) ** {"s": 6, "ms": 3, "us": 0, "ns": -3}[unit]
    with localcontext() as context:
        context.prec = 80
        expected = (Decimal(written) * factor).quantize(Decimal(1), ROUND_HALF_UP)
    path = tmp_path / "a.txt"
    path.write_text(f"9 9\n{written} 1 2 1\n")
    if abs(expected) > 9 * 10**18:
        with pytest.raises(EventFormatError, match="may have a fraction"):
            load_events(path, time_unit=unit)
    else:
        assert load_events(path, time_unit=unit).t_us.tolist() == [int(expected)]


def test_unsorted_text_is_sorted_on_request(tmp_path, monkeypatch):
    """Promise: sort=True gives all events by time, ties in the file's order, in many parts."""
    monkeypatch.setattr(parts, "PART_EVENTS", 100)
    events = random_events(1000)
    order = np.random.default_rng(0).permutation(1000)
    t_us, x, y, p = (column[order] for column in events.columns)
    path = tmp_path / "a.txt"
    np.savetxt(path, np.stack([t_us, x, y, p], axis=1), "%d", header="t_us x y p")
    with pytest.raises(EventFormatError, match="earlier than the previous time"):
        load_events(path, size=(640, 480))
    found = list(read_events(path, size=(640, 480), sort=True))
    assert max(map(len, found)) <= 100
    by_time = np.argsort(t_us, kind="stable")
    assert_same(concatenate(found), make_events(*(c[by_time] for c in (t_us, x, y, p))))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "byte 0: found b''"),
        ("640 480", "byte 0: found b'640 480'"),
        ("640 480 3\n", "byte 0"),
        ("640 480\n320 240\n0.5 1 2 1\n", "byte 8: found another size, b'320 240\\n'"),
        ("640 480\n0.5 1 2 1\n0.4 1 2 1\n", "byte 18: found b'0.4 1 2 1': the time is earlier"),
        ("640 480\n0.5 640 2 1\n", "x is outside the sensor"),
        ("640 480\n0.5 1 480 1\n", "y is outside the sensor"),
        ("640 480\n0.5 1 2 -2\n", "expected p to be 0 or 1, or -1 or 1"),
        (
            "640 480\n0.5 1 2 -1\n0.6 1 2 1\n0.7 1 2 0\n",
            "byte 29: found b'0.7 1 2 0': OFF events",
        ),
        ("640 480\n0.5 1 2 2\n", "expected p to be 0 or 1"),
        ("640 480\n0.5 1 2 9\n", "expected p to be 0 or 1"),
        ("640 480\n0.5 1 2\n", "may have a fraction: t x y p"),
        ("640 480\n0.5 1.5 2 1\n", "may have a fraction: t x y p"),
        ("640 480\n0.5,1,,2,1\n", "may have a fraction: t x y p"),
        ("640 480\n0.5e 1 2 1\n", "may have a fraction: t x y p"),
        ("640 480\n0.1 1 2 1\n0.5e20 1 2 1\n", "may have a fraction: t x y p"),
        ("640 480\n0.5 -1 2 1\n", "x is outside the sensor"),
        ("640 480\n. 1 2 1\n", "may have a fraction: t x y p"),
        ("640 480\n0.5 1 2 1 9\n", "may have a fraction: t x y p"),
        ("640 480\nnan 1 2 1\n", "may have a fraction: t x y p"),
        ("640 480\n99999999999999.5 1 2 1\n", "may have a fraction: t x y p"),
        ("p,x,y,t\n1,1,2\n", "byte 8: found b'1,1,2'"),
        ("640 480\n7 1 2 1\n9 1 2 1\n", "byte 8: the times, 7, 9, are whole numbers"),
        ("640 480\n5e6 1 2 1\n", "the times, 5e6"),
        ("t,x,y,p\n1500.0,1,2,1\n2500.0,1,2,0\n", "the times, 1500.0, 2500.0"),
        ("640 480\n1.5e3 1 2 1\n2500.00 1 2 1\n", "the times, 1.5e3, 2500.00"),
        ("t_min,x,y,p\n1,1,2,1\n", "byte 0"),
        ("t,x,y,q\n1,1,2,1\n", "found b't,x,y,q"),
        ("640 480\n" + "1" * 600, "no end of line within"),
    ],
)
def test_text_that_is_not_events_is_refused(text, said, tmp_path):
    """Promise: the error shows the line that is not an event of this sensor, and its byte."""
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(EventFormatError) as error:
        load_events(path, size=None if text.startswith("640 ") or not text else (640, 480))
    assert said in str(error.value)
    assert str(path) in str(error.value)


@pytest.mark.parametrize("name", ["evt3", "dsec"])
def test_writers_of_one_file_do_not_mix(tmp_path, name):
    """Promise: threads that write the same file leave the events of one of them."""
    path = file_of(tmp_path, name)
    streams = [random_events(20_000, seed=seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as threads:
        counts = list(threads.map(lambda events: write_events(path, events), streams))
    assert counts == [20_000] * 4
    found = load_events(path)
    assert any(np.array_equal(found.t_us, events.t_us) for events in streams)
    assert list(tmp_path.iterdir()) == [path]
