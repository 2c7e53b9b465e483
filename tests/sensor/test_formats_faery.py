"""AEDAT4, DAT and Event Stream: files that faery writes come back, and damage is an error."""

import random

import faery
import numpy as np
import pytest

from event_streams import assert_same, make_events, random_events
from sensor import EventFormatError
from sensor.formats import faery_process, load_events, write_events

pytestmark = pytest.mark.slow
KINDS = ("aedat4", "dat1", "dat2", "es", "atis")


def packet_of(events):
    packet = np.empty(len(events), faery.EVENTS_DTYPE)
    packet["t"], packet["x"], packet["y"] = events.t_us, events.x, events.y
    packet["on"] = events.p > 0
    return packet


def write(folder, kind, events):
    """Write a file with faery; return its path."""
    packet, size = packet_of(events), (events.width, events.height)
    path = folder / f"a.{ {'dat1': 'dat', 'dat2': 'dat', 'atis': 'es'}.get(kind, kind) }"
    if kind == "aedat4":
        faery.events_stream_from_array(packet, size).to_file(path)
    elif kind.startswith("dat"):
        with faery.dat.Encoder(path, kind, "cd", False, size) as encoder:
            columns = [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("payload", "u1")]
            encoder.write(packet.astype(columns))
    else:
        packet["y"] = size[1] - 1 - packet["y"]  # rows from the bottom
        if kind == "atis":
            columns = [("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("exposure", "?")]
            both = np.empty(2 * len(packet), [*columns, ("polarity", "?")])
            for name in ("t", "x", "y"):
                both[name] = np.repeat(packet[name], 2)
            both["exposure"], both["polarity"] = np.tile([True, False], len(packet)), False
            both["polarity"][1::2] = packet["on"]
            packet = both
        with faery.es.Encoder(path, "atis" if kind == "atis" else "dvs", False, size) as encoder:
            encoder.write(packet)
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_files_of_faery(kind, tmp_path):
    """Promise: time, place from the top left and polarity of every event, and the size."""
    events = random_events(5000, width=300, height=200, mean_us=30)
    path = write(tmp_path, kind, events)
    found = load_events(path)
    assert_same(found, events)
    write_events(tmp_path / "a.h5", found)
    assert_same(load_events(tmp_path / "a.h5"), events)


def test_a_dat_file_without_a_size_asks_for_it(tmp_path):
    """Promise: files of old cameras, whose header has no size, are read with that of the user."""
    path = tmp_path / "a.dat"
    words = np.array([5, 3 | 4 << 14 | 1 << 28, 6, 299 | 199 << 14], "<u4")
    path.write_bytes(b"% Data file containing CD events.\n% Version 2\n\x0c\x08" + words.tobytes())
    with pytest.raises(EventFormatError, match="does not store the sensor's size; give it"):
        load_events(path)
    found = load_events(path, size=(300, 200))
    assert_same(found, make_events([5, 6], [3, 299], [4, 199], [1, 0], 300, 200))
    with pytest.raises(EventFormatError, match="found 299, expected less than 299"):
        load_events(path, size=(299, 200))


DAT = b"% Version 2\n% Height 200\n% Width 300\n\x0c\x08"


def test_times_of_dat_that_run_backwards(tmp_path):
    """Promise: they are refused, or sorted on request, and never changed; the clock may wrap."""
    path = tmp_path / "a.dat"
    words = [(2**32 - 7, 1), (2**32 - 9, 2), (1, 3), (0, 4), (5, 5)]
    data = np.array(words, "<u4").tobytes()
    path.write_bytes(DAT + data)
    with pytest.raises(EventFormatError, match="events from 0: its event 1 is earlier"):
        load_events(path)
    t_us = [2**32 - 9, 2**32 - 7, 2**32, 2**32 + 1, 2**32 + 5]
    expected = make_events(t_us, [2, 1, 4, 3, 5], [0] * 5, [0] * 5, 300, 200)
    path.write_bytes(DAT.replace(b"\n\x0c", b"\n% T0 1000\n\x0c") + data)
    assert_same(load_events(path, sort=True), expected.later(1000))


def test_dat_that_ends_within_an_event_is_an_error(tmp_path):
    """Promise: the error counts the bytes of the part."""
    path = tmp_path / "a.dat"
    path.write_bytes(DAT + np.array([5, 1, 6, 2], "<u4").tobytes()[:-3])
    with pytest.raises(EventFormatError, match=r"a\.dat: .* the file ends 5 bytes into an event"):
        load_events(path)


@pytest.mark.parametrize(("kind", "files"), [("aedat4", 4), ("es", 2)])
def test_damage_ends_no_process(kind, files, tmp_path):
    """Promise: damaged files are an error or valid events, also where faery's decoder crashes."""
    path = write(tmp_path, kind, random_events(200, width=300, height=200, mean_us=30))
    data = path.read_bytes()
    chance = random.Random(2)
    outcomes = []
    for k in range(files):
        damaged = bytearray(data[: chance.randrange(len(data))] if k == 0 else data)
        for _ in range(3):
            damaged[chance.randrange(min(len(damaged), 60))] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        try:
            found = load_events(path)
        except EventFormatError as error:
            outcomes.append(str(error).startswith(f"{path}: "))
        else:
            make_events(*found.columns, found.width, found.height)
    assert outcomes
    assert all(outcomes)


def test_a_crash_of_the_decoder_is_an_error(tmp_path):
    """Promise: where faery aborts its process, the error says so."""
    path = write(tmp_path, "es", random_events(9))
    path.write_bytes(b"Event Stream\x02\x00\x00\x01" + bytes(3))
    code = "import os; os.abort()"
    patched = tmp_path / "aborts.py"
    patched.write_text(code)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(faery_process, "__file__", str(patched))
        with pytest.raises(EventFormatError, match="its decoder stopped; the file is damaged"):
            load_events(path)


def test_an_unknown_version_is_named(tmp_path):
    """Promise: AEDAT 2 is refused by name."""
    path = tmp_path / "a.aedat"
    path.write_bytes(b"#!AER-DAT2.0\r\n#Format: RAW\r\n")
    with pytest.raises(EventFormatError, match=r"a.aedat: found AEDAT 2.0"):
        load_events(path)


BACKWARDS = """import sys, struct
out = sys.stdout.buffer
out.write(b'{"size": [9, 9], "others": []}\\n')
for t in (7, 5):
    out.write(struct.pack("<qQHHB", 1, t, t - 4, 2, t == 7))
out.write(struct.pack("<q", -1))
"""


def test_packets_out_of_order(tmp_path):
    """Promise: packets that run backwards are refused, or sorted on request."""
    path = write(tmp_path, "aedat4", random_events(9))
    decoder = tmp_path / "decoder.py"
    decoder.write_text(BACKWARDS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(faery_process, "__file__", str(decoder))
        with pytest.raises(EventFormatError, match="events from 1: its event 0 is earlier"):
            load_events(path)
        found = load_events(path, sort=True)
    assert_same(found, make_events([5, 7], [1, 3], [2, 2], [0, 1], 9, 9))


TALKATIVE = """import sys
sys.stderr.write(100_000 * "a line of a log " + "\\n")
""" + BACKWARDS.replace("(7, 5)", "(5, 7)")


def test_a_decoder_that_says_much_is_not_stopped(tmp_path):
    """Promise: the decoder's events arrive, however much it writes to its log."""
    path = write(tmp_path, "aedat4", random_events(9))
    decoder = tmp_path / "decoder.py"
    decoder.write_text(TALKATIVE)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(faery_process, "__file__", str(decoder))
        found = load_events(path)
    assert_same(found, make_events([5, 7], [1, 3], [2, 2], [0, 1], 9, 9))


def test_what_faery_says_is_shown_in_one_line(tmp_path):
    """Promise: the whole message, although it quotes lines of the file."""
    (tmp_path / "text.es").write_text("hello\n" * 9)
    with pytest.raises(EventFormatError, match=r'bad magic number .*"hello hello "'):
        load_events(tmp_path / "text.es")
