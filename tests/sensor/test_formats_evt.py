"""Prophesee RAW: compared with faery's codecs in both directions, and with the format word by
word."""

import logging

import numpy as np
import pytest
from faery import evt as faery_evt

from event_streams import assert_same, bars, make_events, random_events
from sensor import EventFormatError
from sensor.formats import (
    find_format,
    load_events,
    read_events,
    read_header,
    read_triggers,
    write_events,
)

BOTH = pytest.mark.parametrize("name", ["evt2", "evt3"])

STREAMS = {
    "dense": lambda: random_events(30_000, mean_us=0.01),
    "usual": lambda: random_events(30_000, mean_us=2),
    "sparse": lambda: random_events(3_000, mean_us=30_000),
    "late": lambda: random_events(3_000, start_us=80_000_000_000, mean_us=9),
    "around a turn of EVT3's clock": lambda: random_events(9_000, start_us=(1 << 24) - 4500),
    "around a turn of EVT2's clock": lambda: random_events(9_000, start_us=(1 << 34) - 4500),
    "bars": lambda: bars(40),
    "narrow bars": lambda: bars(40, width=45),
    "long pauses": lambda: make_events(
        [0, 1 << 24, (1 << 24) + 1, 5 << 24, 5 << 36], range(5), range(5), [1, 0, 1, 0, 1]
    ),
    "one": lambda: make_events([4095], [2047], [2047], [1], 2048, 2048),
}


def by_faery(path):
    """Return (version, events) of a RAW file as faery decodes it."""
    with faery_evt.Decoder(path, None, None) as decoder:
        found = [p["events"].copy() for p in decoder if p and "events" in p]
        all_of_them = np.concatenate(found)
        columns = [all_of_them[name] for name in ("t", "x", "y", "on")]
        return decoder.version, make_events(*columns, *decoder.dimensions)


@BOTH
@pytest.mark.parametrize("kind", STREAMS)
def test_an_independent_decoder_reads_what_we_write(name, kind, tmp_path):
    """Promise: faery decodes every event of our files, and above all its time."""
    events = STREAMS[kind]()
    write_events(tmp_path / "a.raw", events, format=name)
    version, decoded = by_faery(tmp_path / "a.raw")
    assert version == name
    assert_same(decoded, events)


@BOTH
def test_times_of_the_clock_of_the_day_have_an_offset(name, tmp_path):
    """Promise: times and sizes beyond EVT's words are stored as faery stores them, and faery reads
    it."""
    events = random_events(3_000, start_us=1_600_000_000_123_457, mean_us=9)
    write_events(tmp_path / "a.raw", events, format=name, t_offset_us=1_600_000_000_000_000)
    assert b"% t0 1600000000000000\n" in (tmp_path / "a.raw").read_bytes()
    assert_same(by_faery(tmp_path / "a.raw")[1], events)
    assert_same(load_events(tmp_path / "a.raw"), events)
    with pytest.raises(EventFormatError, match="subtract an offset first"):
        write_events(tmp_path / "b.raw", events, format=name)


@BOTH
@pytest.mark.parametrize("start_us", [1_000_000_000, -7, (1 << 39) + 6])
def test_the_start_of_the_clock_is_kept(name, start_us, tmp_path):
    """Promise: also of times that fit without it, before zero, and after the first event."""
    events = make_events([0, 4], [1, 3], [2, 2], [1, -1]).later((1 << 39) + 5)
    for stream in (make_events([3, 4], [1, 3], [2, 2], [1, -1]), events):
        path = tmp_path / "a.raw"
        write_events(path, stream, format=name, t_offset_us=start_us)
        assert read_header(path).t_offset_us == start_us
        assert_same(load_events(path), stream)
        assert_same(by_faery(path)[1], stream)
        path.unlink()


@BOTH
def test_a_clock_in_nanoseconds_is_kept(name, tmp_path):
    """Promise: starts of 19 digits are read back up to 2^62 us; beyond, they are refused."""
    path = tmp_path / f"a.{name}.raw"
    for start_us in (1_700_000_000_000_000_005, (1 << 62) - 9):
        events = make_events([0, 4], [1, 3], [2, 2], [1, -1]).later(start_us)
        write_events(path, events, format=name, t_offset_us=start_us)
        assert read_header(path).t_offset_us == start_us
        assert_same(load_events(path), events)
    late = make_events([0], [1], [2], [1]).later((1 << 62) + 9)
    with pytest.raises(EventFormatError, match="the clock starts at 46"):
        write_events(tmp_path / "b.raw", late, format=name, t_offset_us=(1 << 62) + 9)
    assert not (tmp_path / "b.raw").exists()


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".txt", ".raw"])
@pytest.mark.parametrize("start_us", [10**30, 2**63, -(2**63) - 1])
def test_a_clock_beyond_int64_is_refused(suffix, start_us, tmp_path):
    """Promise: in every format, with the number, and no file is left."""
    path, events = tmp_path / f"a{suffix}", make_events([0], [1], [2], [1])
    with pytest.raises(EventFormatError, match=f"t_offset_us: found {start_us}, expected"):
        write_events(path, events, t_offset_us=start_us)
    assert not path.exists()


@BOTH
@pytest.mark.parametrize("from_zero", [False, True])
@pytest.mark.parametrize("kind", STREAMS)
def test_we_read_what_an_independent_encoder_writes(name, kind, from_zero, tmp_path):
    """Promise: our reader reads every event of faery's files, also with an offset `t0` in the
    header."""
    events = STREAMS[kind]()
    path = tmp_path / "a.raw"
    size = events.width, events.height
    with faery_evt.Encoder(path, name, from_zero, size, True) as encoder:
        packet = np.empty(len(events), [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
        packet["t"], packet["x"], packet["y"] = events.t_us, events.x, events.y
        packet["on"] = events.p > 0
        encoder.write({"events": packet})
    assert_same(load_events(path), events)


def words_of(path, dtype):
    data = path.read_bytes()
    start = data.index(b"% end\n") + len(b"% end\n")
    return np.frombuffer(data[start:], dtype)


def test_evt2_word_by_word(tmp_path):
    """Format: type in bits 31..28, low time 27..22, x 21..11, y 10..0; time high from 0."""
    events = make_events([3, 64, 64 * 5 + 63], [5, 6, 639], [7, 8, 479], [1, 0, 1])
    write_events(tmp_path / "a.raw", events, format="evt2")
    assert [f"{w:08x}" for w in words_of(tmp_path / "a.raw", "<u4")] == [
        "80000000",
        f"{1 << 28 | 3 << 22 | 5 << 11 | 7:08x}",
        "80000001",
        f"{6 << 11 | 8:08x}",
        "80000005",
        f"{1 << 28 | 63 << 22 | 639 << 11 | 479:08x}",
    ]


def test_evt3_word_by_word(tmp_path):
    """Format: each word contains what changed; five or more neighbors are one group of vectors."""
    x = [5, 9, 10, 12, 13, 14, 20, 40, 600]
    events = make_events([3] * 8 + [5000], x, [7] * 9, [0] + [1] * 8)
    write_events(tmp_path / "a.raw", events, format="evt3")
    assert [f"{w:04x}" for w in words_of(tmp_path / "a.raw", "<u2")] == [
        "8000",
        "6003",
        "0007",
        f"{2 << 12 | 5:04x}",
        f"{3 << 12 | 1 << 11 | 9:04x}",
        f"{4 << 12 | 0b100000111011:04x}",
        f"{4 << 12:04x}",
        f"{5 << 12 | 1 << 7:04x}",
        "8001",
        f"{6 << 12 | 5000 - 4096:04x}",
        f"{2 << 12 | 1 << 11 | 600:04x}",
    ]


@pytest.mark.parametrize("width", [640, 45, 31])
def test_vectors_are_as_prophesees_decoder_expects_them(width, tmp_path):
    """Promise: vectors come as 12, 12, 8 and lie within the sensor: OpenEB drops all others."""
    events = bars(40, width=width)
    write_events(tmp_path / "a.raw", events)
    words = words_of(tmp_path / "a.raw", "<u2")
    kinds = words >> 12
    firsts = np.flatnonzero(kinds == 4)[::2]
    assert (len(firsts) > 0) == (width >= 32)
    assert len(words) < 0.8 * len(events) or width < 640
    assert np.all(kinds[firsts[:, None] + np.arange(3)] == [4, 4, 5])
    assert np.count_nonzero(kinds == 5) == len(firsts)
    base = -1
    for word, kind in zip(words.tolist(), kinds.tolist(), strict=True):
        if kind == 3:
            base = word & 0x7FF
        elif kind in (4, 5):
            assert base + (12 if kind == 4 else 8) <= width
            base += 12 if kind == 4 else 8


HEADER = b"% evt 3.0\n% format EVT3;height=480;width=640\n% end\n"


def raw(path, header, words, dtype="<u2"):
    path.write_bytes(header + np.array(words, dtype).tobytes())
    return path


def test_evt3_of_a_camera(tmp_path):
    """Format: repeated times, lone vectors, triggers and unknown masters, a clock that wraps."""
    words = [0x8FFF, 0x6001, 0x0005, 0x280A, 0x8FFF, 0xA001, 0xE014, 0xF123, 0x7004]
    words += [0x3064, 0x5081, 0x4801, 0x6001, 0x8000, 0x200B, 0x6002, 0x0805, 0x2805]
    events = load_events(raw(tmp_path / "a.raw", HEADER, words))
    last = 0xFFF001
    assert events.t_us.tolist() == [last, last, last, last, last, 1 << 24, (1 << 24) + 2]
    assert events.x.tolist() == [10, 100, 107, 108, 119, 11, 5]
    assert events.p.tolist() == [1, -1, -1, -1, -1, -1, 1]
    assert set(events.y.tolist()) == {5}


def test_a_stream_that_starts_in_the_middle(tmp_path, caplog):
    """Promise: the reader omits events before the first time and row, and logs their number."""
    words = [0x2001, 0x3002, 0x4003, 0x8001, 0x2003, 0x6001, 0x0004, 0x2005]
    with caplog.at_level(logging.WARNING):
        events = load_events(raw(tmp_path / "a.raw", HEADER, words))
    assert (events.t_us.tolist(), events.x.tolist()) == ([4097], [5])
    assert "skipped 4 events" in caplog.text


def test_headers_of_other_writers(tmp_path):
    """Promise: size from `geometry` or `format`, no `% end`, no size at all; the given version."""
    words = [0x8000, 0x0001, 0x2002]
    for header in (b"% evt 3.0\n% geometry 640x480\n", b"% format EVT3;width=640;height=480\n"):
        assert len(load_events(raw(tmp_path / "a.raw", header, words))) == 1
    bare = raw(tmp_path / "a.raw", b"% Date 2014-02-28\n", words)
    with pytest.raises(EventFormatError, match="does not say which version"):
        load_events(bare)
    with pytest.raises(EventFormatError, match="does not store the sensor's size"):
        load_events(bare, format="evt3")
    assert len(load_events(bare, format="evt3", size=(640, 480))) == 1
    for size in ((640,), 640, (640, 480, 3)):
        with pytest.raises(EventFormatError, match=r"size: found .* in px"):
            load_events(bare, format="evt3", size=size)


def test_a_clock_that_steps_back_stands_still(tmp_path, caplog):
    """Promise: where EVT3's low time steps back, as in files of real cameras, events get the time
    of the event before them, and the log has the largest step; later times are as written."""
    words = [0x8001, 0x0005, 0x6064, 0x2001, 0x6061, 0x2002, 0x6063, 0x2003, 0x6065, 0x2004]
    with caplog.at_level(logging.WARNING):
        events = load_events(raw(tmp_path / "a.raw", HEADER, words))
    assert events.t_us.tolist() == [4196, 4196, 4196, 4197]
    assert events.x.tolist() == [1, 2, 3, 4]
    assert "steps back by up to 3 us in 2 words" in caplog.text


def test_a_low_time_that_turns_before_the_high_one(tmp_path):
    """Promise: between the turn of the low time and the word of the high one, time stands still."""
    words = [0x8001, 0x0005, 0x6FFF, 0x2001, 0x6002, 0x2002, 0x8002, 0x6003, 0x2003]
    events = load_events(raw(tmp_path / "a.raw", HEADER, words))
    assert events.t_us.tolist() == [8191, 8191, 8195]


def test_a_step_back_in_evt2(tmp_path):
    """Promise: the same within the 64 us of an EVT2 word of high time; a high time that steps back
    is an error."""
    header = HEADER.replace(b"3.0", b"2.0").replace(b"EVT3", b"EVT2")
    event = [1 << 28 | t << 22 | 5 << 11 | 7 for t in (9, 4, 10)]
    events = load_events(raw(tmp_path / "a.raw", header, [8 << 28 | 1, *event], "<u4"))
    assert events.t_us.tolist() == [73, 73, 74]
    words = [8 << 28 | 2, event[0], 8 << 28 | 1, event[1]]
    with pytest.raises(EventFormatError, match="68 us, is before the previous time, 137 us"):
        load_events(raw(tmp_path / "b.raw", header, words, "<u4"))


def test_triggers_where_the_clock_steps_back(tmp_path):
    """Promise: triggers stay sorted too."""
    words = [0x8001, 0x6064, 0xA001, 0x6061, 0xA000, 0x6065, 0xA001]
    triggers = read_triggers(raw(tmp_path / "a.raw", HEADER, words))
    assert triggers.t_us.tolist() == [4196, 4196, 4197]
    assert triggers.p.tolist() == [1, -1, 1]


@pytest.mark.parametrize(
    ("lines", "size", "version"),
    [
        (b"% evt 3.0\n% system_ID 49\n% integrator_name Prophesee\n", (1280, 720), "evt3"),
        (b"% system_ID 28\n", (640, 480), "evt2"),
        (b"% system_ID 40\n", (640, 480), "evt3"),
        (b"% evt 3.0\n% system_ID 49\n% geometry 320x240\n", (320, 240), "evt3"),
        (b"% evt 3.0\n% system_ID 49\n% integrator_name Other\n", (None, None), "evt3"),
        (b"% evt 3.0\n% system_ID 9999\n", (None, None), "evt3"),
    ],
)
def test_old_headers_have_the_number_of_the_system(lines, size, version, tmp_path):
    """Promise: without a size in the header, Prophesee's number of the system gives it, as in
    OpenEB; a size in the header takes precedence, and unknown numbers give none."""
    path = raw(tmp_path / "a.raw", lines, [])
    header = read_header(path)
    assert (header.width, header.height) == size
    assert find_format(path).name == version


@pytest.mark.parametrize("first", [0x24, 0x25, 0x26])
def test_a_word_that_begins_like_a_header_is_a_word(first, tmp_path):
    """Promise: a header without an end is over where a line does not begin with "% ", as in
    OpenEB, also where the first word of the clock has this byte."""
    words = [first | 0x8000 << 16, 3 << 11 | 5 | 0x1000 << 16]  # EVT2 in halves: time, then ON
    halves = np.array(words, "<u4").view("<u2")
    path = raw(tmp_path / "a.raw", b"% system_ID 28\n", halves)
    events = load_events(path)
    assert (events.t_us.tolist(), events.x.tolist(), events.y.tolist()) == ([first << 6], [3], [5])


@pytest.mark.parametrize(
    ("header", "words", "said"),
    [
        (b"", [], "byte 0: found no header"),
        (b"% evt 3.0", [], "byte 9: the header ends within a line"),
        (b"% evt \xff\n", [], "expected a line of text"),
        (b"% evt 4.0\n", [], "declares 4.0, expected one version, EVT2 or EVT3"),
        (b"% evt 2.0\n% format EVT3;width=640;height=480\n", [], "declares evt2 and evt3"),
        (b"% geometry 64x48\n" + HEADER, [], "conflicting sizes: [(64, 48), (640, 480)]"),
        (b"% geometry wide\n" + HEADER, [], "geometry: found 'wide'"),
        (b"% geometry 0x0\n% evt 3.0\n", [], "width: found 0"),
        (b"% endianness big\n" + HEADER, [], "endianness"),
        (
            b"% event_count 2\n" + HEADER,
            [0x8000, 0x0001, 0x2001],
            "ends after 1 events, but its header says 2",
        ),
        (b"% event_count x\n" + HEADER, [], "event_count: found 'x'"),
        (b"% event_count 2\n% evt 3.0\n", [], "the header ends without '% end'"),
        (b'% sensor_model {"width": 2}\n' + HEADER, [], "sensor_model: "),
        (b'% sensor_model {"widht": 2}\n' + HEADER, [], "sensor_model.widht: unknown"),
        (b'% sensor_model {"width": "2"}\n' + HEADER, [], "sensor_model.width: found '2'"),
        (
            b'% sensor_model {"width": 640, "height": 9}\n' + HEADER,
            [],
            "sensor_model: has height 9 px",
        ),
        (
            b'% sensor_model {"width": 1, "height": 1, "leak_hz": 1' + 400 * b"0" + b"}\n" + HEADER,
            [],
            "sensor_model: SensorModel.leak_hz: found",
        ),
        (b"% origin []\n" + HEADER, [], "origin: found '[]', expected a JSON object"),
        (HEADER, [0x8000, 0x0001, 0x2FFF], "byte 55, word 0x2fff: found x = 2047, outside"),
        (HEADER, [0x8000, 0x01E0, 0x2001], "byte 55, word 0x2001: found y = 480, outside"),
        (HEADER, [0x8000, 0x0001, 0x327F, 0x5003], "word 0x5003: found x = 640, outside"),
        (HEADER, [0x8000, 0x0001, 0x4003], "word 0x4003: a vector of events comes before"),
        (HEADER, [0x8000, 0x1001], "word 0x1001: the format has no word of this type"),
        (
            HEADER,
            [0x8001, 0x0001, 0x2001, 0x8000, 0x2001],
            "0 us, is before the previous time, 4096 us",
        ),
    ],
)
def test_damage_is_named(header, words, said, tmp_path):
    """Promise: an error in a RAW file names the byte."""
    path = raw(tmp_path / "a.raw", header, words)
    with pytest.raises(EventFormatError) as error:
        load_events(path)
    assert said in str(error.value)
    assert str(error.value).startswith(str(path))


def test_a_word_cut_in_two_is_an_error_after_the_events_before_it(tmp_path):
    """Promise: no loss is silent, and the events before the error are still available."""
    words = np.array([0x8000, 0x0001, 0x2002], "<u2").tobytes()
    (tmp_path / "a.raw").write_bytes(HEADER + words + b"\x02")
    parts = read_events(tmp_path / "a.raw")
    assert [len(next(parts)), len(next(parts))] == [0, 1]
    with pytest.raises(EventFormatError, match="byte 57: the file ends within a word of 2 bytes"):
        next(parts)
