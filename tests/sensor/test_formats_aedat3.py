"""AEDAT 3.1, word by word as its documentation has it, and damage."""

import struct

import numpy as np
import pytest

from event_streams import assert_same, make_events, random_events
from sensor import EventFormatError
from sensor.formats import find_format, load_events, read_header

HEAD = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346B\r\n#!END-HEADER\r\n"


def packet(events, overflow=0, source=1, kind=1, valid=1):
    """Return the bytes of a packet of polarity events."""
    count = len(events)
    head = struct.pack("<hhiiiiii", kind, source, 8, 4, overflow, count, count, count)
    each = zip(*events.columns, strict=True)
    return head + b"".join(
        struct.pack("<Ii", int(x) << 17 | int(y) << 2 | (p > 0) << 1 | valid, int(t) % (1 << 31))
        for t, x, y, p in each
    )


def file_of(path, *packets, head=HEAD):
    path.write_bytes(head + b"".join(packets))
    return path


def test_events_in_packets(tmp_path):
    """Format: time, place from the top left, polarity; the clock overflows at 2^31 us; invalid
    events and other packets are left out; the name of the camera gives the size."""
    early = random_events(500, width=346, height=260, mean_us=30)
    late = random_events(300, width=346, height=260, start_us=(1 << 31) + 5, mean_us=30, seed=1)
    path = file_of(
        tmp_path / "a.aedat",
        packet(early[:200]),
        packet(early[:50], kind=0),  # special events
        packet(early[:70], valid=0),
        packet(early[200:]),
        packet(late, overflow=1),
    )
    assert find_format(path).name == "aedat3"
    assert (read_header(path).width, read_header(path).height) == (346, 260)
    found = load_events(path)
    assert_same(found[:500], early)
    assert_same(found[500:], late)


def test_order_and_sorting(tmp_path):
    """Promise: times that run backwards are an error, or sorted."""
    events = random_events(50, width=346, height=260, mean_us=30)
    path = file_of(tmp_path / "a.aedat", packet(events[30:]), packet(events[:30]))
    with pytest.raises(EventFormatError, match="sort=True"):
        load_events(path)
    assert_same(load_events(path, sort=True), events)


@pytest.mark.parametrize(
    ("head", "packets", "said"),
    [
        (HEAD.replace(b"RAW", b"Compressed"), [], "Format: found Compressed, expected RAW"),
        (HEAD[:30], [], "the header ends without #!END-HEADER"),
        (HEAD, [b"\x01\x00"], "the file ends within a packet"),
        (HEAD, ["whole", -3], "the file ends within a packet"),
        (HEAD, [b"\xff" * 28], "expected the header of a packet"),
        (HEAD, ["huge"], "the file ends within a packet"),
        (HEAD, ["whole", "other"], "from 2 cameras"),
        (HEAD, ["outside"], "found 346, expected less than 346"),
        (HEAD.replace(b"DAVIS346B", b"Mine"), ["whole"], "does not store the sensor's size"),
        (HEAD.replace(b"3.1", b"2.0"), [], "found AEDAT 2.0"),
    ],
)
def test_damage_is_named(head, packets, said, tmp_path):
    """Promise: an error names the file and what was found."""
    events = random_events(20, width=346, height=260)
    made = {
        "whole": packet(events),
        "other": packet(events, source=2),
        "huge": bytes(7) + b"\x40" + packet(events)[8:],  # events of 1 GiB
        "outside": packet(make_events([5], [346], [3], [1])),
    }
    data = b""
    for one in packets:
        data = data[:one] if isinstance(one, int) else data + made.get(one, one)
    path = file_of(tmp_path / "a.aedat", data, head=head)
    with pytest.raises(EventFormatError) as error:
        load_events(path)
    assert said in str(error.value)
    assert str(error.value).startswith(str(path))


def test_a_truncated_file_is_an_error_or_ends_at_a_packet(tmp_path):
    """Promise: no part of a packet is lost without an error."""
    events = random_events(60, width=346, height=260)
    whole = file_of(tmp_path / "a.aedat", packet(events[:30]), packet(events[30:])).read_bytes()
    ends = {len(HEAD): 0, len(HEAD) + 28 + 240: 30, len(whole): 60}
    for size in np.unique([*range(len(HEAD), len(whole), 37), *ends]):
        path = tmp_path / "b.aedat"
        path.write_bytes(whole[:size])
        if size in ends:
            assert len(load_events(path)) == ends[size]
        else:
            with pytest.raises(EventFormatError, match="ends within a packet"):
                load_events(path)
