"""AEDAT 3.1, the files of cAER and of other programs with libcaer: polarity events, uncompressed.

    #!AER-DAT3.1            lines of text that end with "\\r\\n"
    #Format: RAW
    #Source 1: DAVIS240C
    #!END-HEADER

Packets follow, little-endian: int16 type (1 for polarity) and source, then int32 size of an event,
offset of its time, overflows of the clock, capacity, number of events, number of valid ones. A
polarity event is

    31..17  16..2   1           0           a word
    x       y       brighter    valid

and int32 microseconds; an overflow counts 2^31 us. (0, 0) is the top-left pixel. See
https://docs.inivation.com/software/software-advanced-usage/file-formats/aedat-3.1.html.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from sensor.errors import EventFormatError
from sensor.events import Events, no_events
from sensor.formats import batching
from sensor.formats.header import Header

MAGIC = b"#!AER-DAT3.1"
_END = b"#!END-HEADER"
_MAX_HEADER_BYTES = 1 << 16
_FIELDS = "size", "place", "overflow", "capacity", "number", "valid"
_PACKET = np.dtype([("type", "<i2"), ("source", "<i2"), *((name, "<i4") for name in _FIELDS)])
_EVENT = np.dtype([("word", "<u4"), ("t", "<i4")])
_POLARITY = 1
_SIZES = {
    "DVS128": (128, 128),
    "DAVIS128": (128, 128),
    "DAVIS208": (208, 192),
    "DAVIS240": (240, 180),
    "DAVIS346": (346, 260),
    "DAVIS640": (640, 480),
}


def _read_lines(file: BinaryIO) -> list[str]:
    """Return the lines of the header, and leave the file at the first packet."""
    if file.read(len(MAGIC)) != MAGIC:
        raise EventFormatError(f"byte 0: the file does not start with {MAGIC.decode()}")
    file.seek(0)
    lines: list[str] = []
    while file.tell() < _MAX_HEADER_BYTES:
        line = file.readline(_MAX_HEADER_BYTES)
        if line.startswith(_END):
            return lines
        if not line.startswith(b"#"):
            break
        lines.append(line[1:].decode("latin-1").strip())
    raise EventFormatError(f"byte {file.tell()}: the header ends without {_END.decode()}")


def _header(lines: list[str]) -> Header:
    stored = [line.partition(":")[2].strip() for line in lines if line.startswith("Format:")]
    if stored != ["RAW"]:
        raise EventFormatError(f"header, Format: found {', '.join(stored) or 'none'}, expected RAW")
    sources = (re.match(r"Source \d+: *((?:DVS|DAVIS)\d+)", line) for line in lines)
    sizes = {_SIZES.get(source[1]) for source in sources if source}
    size = sizes.pop() if len(sizes) == 1 else None
    return Header(*(size or (None, None)))


def read_header(path: Path) -> Header:
    """Read the header of a file; the name of its camera gives the size."""
    with path.open("rb") as file:
        return _header(_read_lines(file))


def read(path: Path, header: Header, *, sort: bool = False) -> Iterator[Events]:
    """Read the valid polarity events of a file, packet by packet; others are left out."""
    none = no_events(*header.size, header.model)
    yield from batching.in_order(_packets(path, none), none, sort=sort)


def _packets(path: Path, none: Events) -> Iterator[tuple[str, Events]]:
    """Yield where each packet is, and its events."""
    sources: set[int] = set()
    with path.open("rb") as file:
        _read_lines(file)
        while True:
            at = file.tell()
            packet = _read_packet(file, at, sources)
            if packet is None:
                return
            t_us, word = packet
            x, y = ((word >> 17).astype(np.uint16), (word >> 2 & 0x7FFF).astype(np.uint16))
            on, where = word & 2 > 0, f"byte {at}"
            yield where, batching.with_checked_places(t_us, x, y, on, where, none)


def _read_packet(
    file: BinaryIO, at: int, sources: set[int]
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return times and words of the valid polarity events of a packet, None at the end."""
    start = file.read(_PACKET.itemsize)
    if not start:
        return None
    if len(start) < _PACKET.itemsize:
        raise EventFormatError(f"byte {at}: the file ends within a packet")
    packet = np.frombuffer(start, _PACKET)[0]
    number, size = int(packet["number"]), int(packet["size"])
    if number < 0 or size <= 0 or packet["capacity"] != number or packet["overflow"] < 0:
        raise EventFormatError(f"byte {at}: found {start.hex()}, expected the header of a packet")
    # A damaged header may name more than memory holds.
    if number * size > os.fstat(file.fileno()).st_size - file.tell():
        raise EventFormatError(f"byte {at}: the file ends within a packet")
    data = file.read(number * size)
    if packet["type"] != _POLARITY:
        return np.empty(0, np.int64), np.empty(0, np.uint32)
    sources.add(int(packet["source"]))
    if size != _EVENT.itemsize or len(sources) > 1:
        raise EventFormatError(
            f"byte {at}: found events of {size} bytes from {len(sources)} cameras, expected "
            f"{_EVENT.itemsize} bytes from one camera"
        )
    events = np.frombuffer(data, _EVENT)
    events = events[events["word"] & 1 == 1]
    if np.any(events["t"] < 0):
        raise EventFormatError(f"byte {at}: found time {events['t'].min()} us, expected 0 or more")
    t_us = (np.int64(packet["overflow"]) << 31) + events["t"].astype(np.int64)
    return t_us, events["word"]
