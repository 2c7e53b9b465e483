"""External triggers: those of faery's files, and through every format that stores them."""

import h5py
import numpy as np
import pytest
from faery import evt as faery_evt
from hypothesis import given, settings
from hypothesis import strategies as st

from event_streams import SUFFIXES, assert_same, make_events, random_events, streams
from sensor import EventFormatError
from sensor.formats import Triggers, load_events, read_header, read_triggers, write_events

KEPT = pytest.mark.parametrize("name", ["dsec", "evt3", "evt2", "npz"])
EVT = pytest.mark.parametrize("name", ["evt2", "evt3"])


def make_triggers(t_us, channel=None, p=None):
    t_us = np.asarray(t_us, np.int64)
    channel = np.zeros(len(t_us)) if channel is None else channel
    p = np.resize([1, -1], len(t_us)) if p is None else p
    return Triggers(t_us, np.asarray(channel, np.uint8), np.asarray(p, np.int8))


def assert_same_triggers(a, b):
    for name in ("t_us", "channel", "p"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@KEPT
@settings(max_examples=20)
@given(events=streams(), t_us=st.lists(st.integers(0, 1 << 31), max_size=9), data=st.data())
def test_every_trigger_comes_back(name, events, t_us, data, tmp_path):
    """Promise: triggers before, between and after events come back, and change no event."""
    n = len(t_us)
    channel = data.draw(st.lists(st.integers(0, 15), min_size=n, max_size=n))
    triggers = make_triggers(sorted(t_us), channel)
    path = tmp_path / f"a{SUFFIXES[name]}"
    write_events(path, events, format=name, triggers=triggers)
    assert_same(load_events(path, format=name), events)
    assert_same_triggers(read_triggers(path, format=name), triggers)


@EVT
def test_triggers_beside_a_clock_of_the_day(name, tmp_path):
    """Promise: an offset of the times in the header is that of the triggers too."""
    events = random_events(300, start_us=1_600_000_000_123_457, mean_us=9)
    triggers = make_triggers(events.t_us[[5, 5, 70]] + 1)
    path = tmp_path / "a.raw"
    start_us = 1_600_000_000_000_000
    write_events(path, events, format=name, t_offset_us=start_us, triggers=triggers)
    assert_same(load_events(path), events)
    assert_same_triggers(read_triggers(path), triggers)


@EVT
def test_faery_reads_our_triggers(name, tmp_path):
    """Promise: times, channels and edges are those of an independent decoder."""
    events = random_events(3000, mean_us=40)
    edges = np.arange(300, 110_000, 9_001)
    triggers = make_triggers(edges, np.arange(len(edges)) % 3)
    path = tmp_path / "a.raw"
    write_events(path, events, format=name, triggers=triggers)
    found = []
    with faery_evt.Decoder(path, None, None) as decoder:
        for packet in decoder:
            if packet and "triggers" in packet:
                found.append(packet["triggers"].copy())
    found = np.concatenate(found)
    np.testing.assert_array_equal(found["t"], triggers.t_us)
    np.testing.assert_array_equal(found["source"], triggers.channel)
    np.testing.assert_array_equal(found["rising"], triggers.p > 0)


def test_words_of_triggers(tmp_path):
    """Format: EVT3 has the channel in bits 11..8 and the edge in bit 0; the time is the clock's."""
    words = [0xA101, 0x8001, 0x6005, 0xA301, 0xA300, 0x8002, 0xA001]
    header = b"% evt 3.0\n% format EVT3;height=480;width=640\n% end\n"
    (tmp_path / "a.raw").write_bytes(header + np.array(words, "<u2").tobytes())
    found = read_triggers(tmp_path / "a.raw")
    assert found.t_us.tolist() == [4101, 4101, 8192]  # the first has no time yet
    assert (found.channel.tolist(), found.p.tolist()) == ([3, 3, 0], [1, -1, 1])


@KEPT
def test_damage_gives_an_error_or_valid_triggers(name, tmp_path):
    """Promise: a damaged file gives an `EventFormatError` or valid triggers, nothing else."""
    triggers = make_triggers(range(0, 900, 50))
    path = tmp_path / f"a{SUFFIXES[name]}"
    write_events(path, random_events(30, mean_us=9), format=name, triggers=triggers)
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for k in range(200):
        damaged = bytearray(data[: len(data) * k // 200] if k % 2 else data)
        if k % 2 == 0:
            damaged[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        try:
            found = read_triggers(path, format=name)
        except EventFormatError:
            refused += 1
            continue
        Triggers(found.t_us, found.channel, found.p)
        if name in ("dsec", "npz") and len(found):  # checksums
            assert_same_triggers(found, triggers)
    assert refused > 20


@pytest.mark.parametrize("group", [True, False])
def test_triggers_of_other_programs(group, tmp_path):
    """Promise: a file whose `triggers` are not as ours are is read, and they count as other data;
    ours that lack a column are refused."""
    events = random_events(30)
    path = tmp_path / "a.h5"
    write_events(path, events)
    with h5py.File(path, "r+") as file:
        file["triggers/camera" if group else "triggers"] = np.arange(3)
    assert_same(load_events(path), events)
    assert len(read_triggers(path)) == 0
    assert read_header(path).others == ("triggers",)
    if group:
        with h5py.File(path, "r+") as file:
            file["triggers/t_us"] = np.arange(3)
        with pytest.raises(EventFormatError, match="triggers/channel: missing"):
            read_triggers(path)


@EVT
def test_triggers_are_not_lost_at_the_end(name, tmp_path):
    """Promise: a file that is truncated after its last event, but before its last trigger, is
    refused by readers of both, also within a word."""
    path = tmp_path / "a.raw"
    events, triggers = random_events(20, mean_us=9), make_triggers(range(0, 60_000, 3000))
    write_events(path, events, format=name, triggers=triggers)
    data = path.read_bytes()
    assert len(read_triggers(path)) == 20
    for cut in (1, *range(4, 80, 4), 91):
        path.write_bytes(data[:-cut])
        for read in (read_triggers, load_events):
            with pytest.raises(EventFormatError, match=r"the file ends (after|within a word)"):
                read(path)


@KEPT
@pytest.mark.parametrize("start_us", [0, 1_699_999_999_000_000, -5])
def test_the_start_of_the_clock_goes_through_npz(name, start_us, tmp_path):
    """Promise: what comes from another format through npz is what comes from it at once."""
    events = random_events(300, start_us=max(0, start_us), mean_us=9)
    paths = [tmp_path / f"{k}{SUFFIXES[name]}" for k in range(2)]
    write_events(tmp_path / "a.npz", events, t_offset_us=start_us)
    assert read_header(tmp_path / "a.npz").t_offset_us == start_us
    write_events(paths[0], events, format=name, t_offset_us=start_us)
    again = load_events(tmp_path / "a.npz"), read_header(tmp_path / "a.npz").t_offset_us
    write_events(paths[1], again[0], format=name, t_offset_us=again[1])
    assert paths[0].read_bytes() == paths[1].read_bytes()


def test_text_does_not_keep_the_start_of_the_clock(tmp_path, caplog):
    path = tmp_path / "a.txt"
    write_events(path, random_events(9), t_offset_us=5)
    assert caplog.messages == [
        f"{path}: the format 'text, t x y p' cannot store start of the clock"
    ]


@pytest.mark.parametrize(
    ("name", "triggers", "said"),
    [
        ("evt3", ([5], [16]), "channels up to 16, .* on channels 0 to 15"),
        ("evt2", ([5], [32]), "channels up to 32, .* on channels 0 to 31"),
        ("evt3", ([-5], [0]), "found triggers from -5 to -5 us"),
    ],
)
def test_triggers_that_a_format_cannot_hold(name, triggers, said, tmp_path):
    """Promise: they are refused, and no file is left."""
    with pytest.raises(EventFormatError, match=said):
        write_events(
            tmp_path / "a.raw", random_events(3), format=name, triggers=make_triggers(*triggers)
        )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (([2, 1], [0, 0], [1, 1]), "not in ascending order"),
        (([1, 2], [0], [1, 1]), "channel: found uint8 of shape"),
        (([1], [0], [0]), "p: found values other than"),
    ],
)
def test_invalid_triggers(columns, said):
    """Promise: the error names the column."""
    with pytest.raises(EventFormatError, match=said):
        make_triggers(*columns)


@pytest.mark.parametrize("suffix", [".h5", ".raw", ".npz", ".txt", ".bag"])
def test_a_file_that_is_not_there_is_an_os_error(suffix, tmp_path):
    """Promise: as for events, whatever the format."""
    with pytest.raises(FileNotFoundError, match=f"none{suffix}"):
        read_triggers(tmp_path / f"none{suffix}")


def test_triggers_are_arrays():
    with pytest.raises(EventFormatError, match="triggers, t_us: found list"):
        Triggers([12], [0], [1])


def test_a_damaged_entry_is_named(tmp_path):
    """Promise: npz names the entry of triggers that is missing."""
    events = make_events([1], [2], [3], [1])
    columns = {name: getattr(events, name) for name in ("t_us", "x", "y", "p")}
    np.savez(tmp_path / "a.npz", **columns, trigger_t_us=np.array([5]))
    with pytest.raises(EventFormatError, match=r"a.npz: entry trigger_channel: missing"):
        read_triggers(tmp_path / "a.npz")
