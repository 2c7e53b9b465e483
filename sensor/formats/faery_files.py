"""AEDAT4, Prophesee DAT and Event Stream files, read by faery in a process of its own.

faery's decoders end their process on some damaged files; here that is an error like any other.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from sensor.errors import EventFormatError
from sensor.events import Events, no_events
from sensor.formats import batching, faery_process
from sensor.formats.header import Header

_MAX_TIME_US = 1 << 62


@contextmanager
def _decoding(path: Path, kind: str, *options: str) -> Iterator[IO[bytes]]:
    """Start faery; at the end, raise its error unless it ended well or we stopped reading."""
    import faery  # noqa: F401  (an error here says that it is missing)

    # -P: the script must not import the modules beside it.
    command = [sys.executable, "-P", faery_process.__file__, kind, str(path.absolute()), *options]
    # Its errors go to a file: a full pipe would stop it while its events are read.
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process,
    ):
        assert process.stdout is not None
        try:
            yield process.stdout
        except _Ended:
            code = process.wait()
            errors.seek(0)
            lines = errors.read().decode("utf-8", "replace").strip().splitlines()
            reason = lines[-1] if code > 0 and lines else "its decoder stopped; the file is damaged"
            raise EventFormatError(f"faery cannot read it: {reason}") from None
        finally:
            process.kill()


class _Ended(Exception):
    """faery's process ended before the end of the events."""


def _taken(pipe: IO[bytes], size: int) -> bytes:
    data = pipe.read(size)
    if len(data) < size:
        raise _Ended
    return data


def _header(pipe: IO[bytes]) -> Header:
    line = pipe.readline()
    if not line.endswith(b"\n"):
        raise _Ended
    header = json.loads(line)
    width, height = header["size"] or (None, None)
    return Header(width, height, others=tuple(header["others"]))


def read_header(path: Path, kind: str) -> Header:
    """Read the header of a file."""
    with path.open("rb") as file:
        start = file.read(14)
    if kind == "aedat4" and start.startswith(b"#!AER-DAT") and start[9:12] != b"4.0":
        raise EventFormatError(
            f"found AEDAT {start[9:12].decode('latin-1')}; only AEDAT 4.0 and 3.1 can be read"
        )
    with _decoding(path, kind, "header") as pipe:
        return _header(pipe)


def read(path: Path, header: Header, kind: str, *, sort: bool = False) -> Iterator[Events]:
    """Read the events of a file."""
    none = no_events(*header.size, header.model)
    yield from batching.in_order(_packets(path, none, kind), none, sort=sort)


def _packets(path: Path, none: Events, kind: str) -> Iterator[tuple[str, Events]]:
    """Yield the number of the first event of each packet, and its events."""
    done = 0
    with _decoding(path, kind) as pipe:
        _header(pipe)
        while (count := struct.unpack("<q", _taken(pipe, 8))[0]) != faery_process.END:
            data = _taken(pipe, count * faery_process.EVENT.itemsize)
            where = f"events from {done}"
            yield where, _checked(np.frombuffer(data, faery_process.EVENT), where, none)
            done += count


def _checked(packet: np.ndarray, where: str, none: Events) -> Events:
    """Convert a packet to `Events` and check its values, except for the order of its times."""
    latest = packet["t"].max(initial=0)
    if latest >= _MAX_TIME_US:
        raise EventFormatError(
            f"{where}: found time {latest} us, expected less than {_MAX_TIME_US} us"
        )
    t_us = packet["t"].astype(np.int64)
    x, y = (np.ascontiguousarray(packet[name]) for name in ("x", "y"))
    return batching.with_checked_places(t_us, x, y, packet["on"] > 0, where, none)
