"""The process in which faery decodes a file: a damaged file can end it, but not its caller.

    python faery_process.py FORMAT PATH [header]

Standard output is a line of JSON with the header; then packets, each its number of events (int64)
and as many of `EVENT`; then -1. An error is the last line of standard error.
"""

import json
import struct
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

EVENT = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "u1")])
END = -1
_DAT_EVENT = np.dtype([("t", "<u4"), ("word", "<u4")])
_UNKNOWN = (0xFFFF, 0xFFFF)  # px, a size that no DAT file has: its coordinates have 14 bits


def _opened(kind: str, path: str) -> tuple[dict[str, Any], Iterator[Any]]:
    """Return the header and an iterator of packets of faery."""
    import faery

    if kind == "aedat4":
        decoder = faery.aedat.Decoder(path)
        tracks = decoder.tracks()
        chosen = next((track for track in tracks if track.data_type == "events"), None)
        if chosen is None:
            raise ValueError("the file has no track of events")
        others = [f"{track.data_type} (track {track.id})" for track in tracks if track != chosen]
        packets = (packet for track, packet in decoder if track.id == chosen.id)
        return {"size": chosen.dimensions, "others": others}, packets
    if kind == "dat":
        decoder = faery.dat.Decoder(path, _UNKNOWN, None)
        events = ("cd", "2d")
    else:
        decoder = faery.es.Decoder(path, 0)
        events = ("dvs", "atis")
    if decoder.event_type not in events:
        raise ValueError(f"the file stores {decoder.event_type!r}, expected {' or '.join(events)}")
    size = None if decoder.dimensions == _UNKNOWN else decoder.dimensions
    stored = _with_stored_times(path, decoder) if kind == "dat" else decoder
    return {"size": size, "others": []}, stored


def _with_stored_times(path: str, packets: Iterator[Any]) -> Iterator[Any]:
    """Yield packets of a DAT file with its own times where they run backwards.

    faery gives such events the time before, and omits a partial event at the end, an error here.
    """
    with open(path, "rb") as file:
        start, t0 = 0, 0
        while (line := file.readline()).startswith(b"%"):
            start += len(line)
            if (words := line[1:].split())[:1] == [b"T0"]:  # faery's offset of all times
                t0 = int(words[1])
        file.seek(start + 2)  # type and size of an event
        for packet in packets:
            stored = np.frombuffer(file.read(_DAT_EVENT.itemsize * len(packet)), _DAT_EVENT)
            late = (packet["t"] - t0 - stored["t"]) & 0xFFFFFFFF  # the clock has 32 bits
            if np.any(late):
                packet = packet.copy()
                packet["t"] -= late
            yield packet
        if rest := file.read(_DAT_EVENT.itemsize):
            raise ValueError(f"the file ends {len(rest)} bytes into an event")


def _columns(packet: Any, kind: str, height: int) -> Any:
    """Return the events of a packet, with the row 0 at the top."""
    names = packet.dtype.names
    if "exposure" in names:  # of ATIS: its measurements of light are not events
        packet = packet[~packet["exposure"]]
    events = np.empty(len(packet), EVENT)
    events["t"], events["x"] = packet["t"], packet["x"]
    events["y"] = height - 1 - packet["y"] if kind == "es" else packet["y"]
    brighter = next(name for name in ("on", "polarity", "payload") if name in names)
    events["on"] = packet[brighter] > 0
    return events


def main(kind: str, path: str, only_header: bool) -> None:
    """Decode a file to standard output."""
    out = sys.stdout.buffer
    header, packets = _opened(kind, path)
    out.write(json.dumps(header).encode() + b"\n")
    if only_header:
        return
    for packet in packets:
        events = _columns(packet, kind, (header["size"] or (0, 0))[1])
        out.write(struct.pack("<q", len(events)))
        out.write(events.data)
    out.write(struct.pack("<q", END))


if __name__ == "__main__":
    try:
        main(sys.argv[1], sys.argv[2], sys.argv[3:] == ["header"])
    except BaseException as error:  # faery's panics are not of type `Exception`
        print(f"\n{' '.join(str(error).split()) or type(error).__name__}", file=sys.stderr)
        sys.exit(1)
