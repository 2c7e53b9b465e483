"""ROS 1 bags with messages dvs_msgs/EventArray or prophesee_event_msgs/EventArray, by rosbags.

Both have the same layout, packed and little-endian:

    uint32 seq, uint32 s, uint32 ns, uint32 n, n bytes          the header
    uint32 height, uint32 width
    uint32 count, then of each event: uint16 x, uint16 y, uint32 s, uint32 ns, uint8 polarity
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.events import Events, no_events
from sensor.formats import batching
from sensor.formats.header import Header
from sensor.model import MAX_SIDE_PX

TYPES = ("dvs_msgs/msg/EventArray", "prophesee_event_msgs/msg/EventArray")
_PACKETS = "event_camera_msgs/msg/EventPacket"
_EVENT = np.dtype([("x", "<u2"), ("y", "<u2"), ("s", "<u4"), ("ns", "<u4"), ("on", "u1")])


def _opened(path: Path) -> Any:
    """Open a bag."""
    from rosbags.rosbag1 import Reader

    return Reader(path)


def _topics(reader: Any) -> list[Any]:
    """Return the connections with events, by topic."""
    with_events = [c for c in reader.connections if c.msgtype in TYPES]
    if not with_events:
        types = {connection.msgtype for connection in reader.connections}
        hint = "; event_camera_tools (ROS) converts its packets" if _PACKETS in types else ""
        present, expected = ", ".join(sorted(map(_named, types))), " or ".join(map(_named, TYPES))
        raise EventFormatError(f"found messages {present or 'none'}, expected {expected}{hint}")
    return sorted(with_events, key=lambda connection: connection.topic)


def _named(msgtype: str) -> str:
    return msgtype.replace("/msg/", "/")


def _chosen(reader: Any, topic: str | None) -> list[Any]:
    """Return the connections of one topic."""
    connections = _topics(reader)
    names = sorted({connection.topic for connection in connections})
    if topic not in names and (topic is not None or len(names) > 1):
        raise EventFormatError(
            f"topic: {topic or 'none'} given; choose from {', '.join(names)} (topic=, --topic)"
        )
    return [connection for connection in connections if topic in (None, connection.topic)]


def read_header(path: Path, *, topic: str | None = None) -> Header:
    """Read the size of the sensor from the first message of a topic."""
    with _opened(path) as reader:
        chosen = _topics(reader) if topic is None else _chosen(reader, topic)
        firsts = [next(reader.messages([connection]), None) for connection in chosen]
        sizes = {_parsed(first[2], 0)[1:] for first in firsts if first is not None}
        every, own = (
            {f"{connection.topic} ({_named(connection.msgtype)})" for connection in connections}
            for connections in (reader.connections, chosen)
        )
    sizes.discard((0, 0))  # of a message that does not know it
    width, height = sizes.pop() if len(sizes) == 1 else (None, None)
    return Header(width, height, others=tuple(sorted(every - own)))


def _parsed(data: bytes, number: int) -> tuple[np.ndarray, int, int]:
    """Return the events of a message, and the width and height of the sensor."""
    with reading(f"message {number}: found {len(data)} bytes, which are not an array of events"):
        (named,) = struct.unpack_from("<I", data, 12)
        height, width, count = struct.unpack_from("<III", data, 16 + named)
        start = 28 + named
        if start + count * _EVENT.itemsize != len(data):
            raise EventFormatError(
                f"declares {count} times {_EVENT.itemsize} bytes from {start} on"
            )
        return np.frombuffer(data, _EVENT, count, start), width, height


def read(
    path: Path, header: Header, *, sort: bool = False, topic: str | None = None
) -> Iterator[Events]:
    """Read the events of a bag."""
    none = no_events(*header.size, header.model)
    yield from batching.in_order(_messages(path, none, topic), none, sort=sort)


def _messages(path: Path, none: Events, topic: str | None) -> Iterator[tuple[str, Events]]:
    """Yield which message it is, and its events."""
    is_any = none.width == none.height == MAX_SIDE_PX
    with _opened(path) as reader:
        for number, (_, _, data) in enumerate(reader.messages(_chosen(reader, topic))):
            events, width, height = _parsed(data, number)
            # A reader without a size, such as `eres info`, takes any.
            if (width, height) not in ((none.width, none.height), (0, 0)) and not is_any:
                raise EventFormatError(
                    f"message {number}: found a sensor of {width}x{height} px, expected "
                    f"{none.width}x{none.height} px"
                )
            t_us = events["s"].astype(np.int64) * 1_000_000 + events["ns"] // 1000
            x, y = (np.ascontiguousarray(events[name]) for name in ("x", "y"))
            on, where = events["on"] > 0, f"message {number}"
            yield where, batching.with_checked_places(t_us, x, y, on, where, none)
