"""npz: the columns as uncompressed NumPy arrays, for `numpy.load`.

`t_us` int64, `x` and `y` uint16, `p` int8 (+1, -1), `width`, `height`, as JSON text `origin` and,
if the events have a model, `sensor_model`; if there are triggers, `trigger_t_us`,
`trigger_channel` (uint8) and `trigger_p`; if the clock does not start at 0, `t_offset_us`.
"""

from __future__ import annotations

import shutil
import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.events import Events, no_events
from sensor.formats import batching
from sensor.formats.header import Header, facts_from_json, facts_to_json
from sensor.formats.triggers import NO_TRIGGERS, Triggers
from sensor.growth import check_growth

_KINDS = {"t_us": "<i8", "x": "<u2", "y": "<u2", "p": "i1"}
_COLUMNS: dict[str, np.dtype[Any]] = {name: np.dtype(kind) for name, kind in _KINDS.items()}
_TRIGGERS = ("trigger_t_us", "trigger_channel", "trigger_p")
_ENTRIES = {*_COLUMNS, *_TRIGGERS, "width", "height", "sensor_model", "origin", "t_offset_us"}
_MAX_TEXT_BYTES = 1 << 20
_COPY_BYTES = 1 << 20
_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest in zip: the file must depend on its events only


def write(path: Path, header: Header, parts: Iterable[Events]) -> int:
    """Write an npz file.

    The length of an array precedes its values, and that of a stream is unknown before its end. So
    the columns are first written to temporary files, which need as much disk space again.
    """
    count = 0
    path.open("wb").close()  # errors then name the file, not a temporary one
    with ExitStack() as stack:
        spilled = {
            name: stack.enter_context(tempfile.TemporaryFile(dir=path.parent)) for name in _COLUMNS
        }
        for part in parts:
            for name, file in spilled.items():
                column = np.ascontiguousarray(getattr(part, name), dtype=_COLUMNS[name])
                file.write(column.data)
            count += len(part)
        archive = stack.enter_context(zipfile.ZipFile(path, "w", zipfile.ZIP_STORED))
        small = {"width": header.width, "height": header.height, **facts_to_json(header)}
        if header.t_offset_us:
            small["t_offset_us"] = header.t_offset_us
        if len(header.triggers):
            for name in _TRIGGERS:
                small[name] = getattr(header.triggers, name.removeprefix("trigger_"))
        for name, value in small.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _DATE), "w") as entry:
                np.lib.format.write_array(entry, np.asarray(value), allow_pickle=False)
        for name, file in spilled.items():
            kind = np.lib.format.dtype_to_descr(_COLUMNS[name])
            described = {"descr": kind, "fortran_order": False, "shape": (count,)}
            info = zipfile.ZipInfo(f"{name}.npy", _DATE)
            with archive.open(info, "w", force_zip64=True) as entry:
                np.lib.format.write_array_header_1_0(entry, described)
                file.seek(0)
                shutil.copyfileobj(file, entry, _COPY_BYTES)
    return count


@contextmanager
def _opened(
    archive: zipfile.ZipFile, name: str
) -> Iterator[tuple[IO[bytes], tuple[int, ...], np.dtype]]:
    """Open an entry at its first value, with its shape and dtype."""
    with ExitStack() as stack:
        with reading(f"entry {name}"):
            if f"{name}.npy" not in archive.namelist():
                raise EventFormatError("missing")
            info = archive.getinfo(f"{name}.npy")
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise EventFormatError(
                    f"found compression {info.compress_type}, expected none or deflate"
                )
            stored = min(info.compress_size, Path(str(archive.filename)).stat().st_size)
            check_growth(info.file_size, stored)
            entry = stack.enter_context(archive.open(info))
            version = np.lib.format.read_magic(entry)
            if version != (1, 0):
                raise EventFormatError(f"found npy version {version}, expected (1, 0)")
            shape, _, dtype = np.lib.format.read_array_header_1_0(entry)  # of at most one dimension
        yield entry, shape, dtype


def _read_scalar(archive: zipfile.ZipFile, name: str, kind: str) -> Any:
    """Read a number or a text without dimensions."""
    with _opened(archive, name) as (entry, shape, dtype), reading(f"entry {name}"):
        if shape != () or dtype.kind not in kind or dtype.itemsize > _MAX_TEXT_BYTES:
            raise EventFormatError(f"found {dtype} of shape {shape}, expected one value")
        data = entry.read(dtype.itemsize + 1)
        if len(data) != dtype.itemsize:
            raise EventFormatError(f"found {len(data)} bytes, expected {dtype.itemsize}")
        return np.frombuffer(data, dtype)[0].item()


def read_header(path: Path) -> Header:
    """Read the size, model, origin and start of the clock of an npz file."""
    with zipfile.ZipFile(path) as archive:
        names = [name.removesuffix(".npy") for name in archive.namelist()]
        kinds = dict.fromkeys(("width", "height", "t_offset_us"), "iu")
        kinds |= dict.fromkeys(("sensor_model", "origin"), "U")
        small = {name: _read_scalar(archive, name, k) for name, k in kinds.items() if name in names}
    others = tuple(name for name in names if name not in _ENTRIES)
    size = small.get("width"), small.get("height")
    return Header(*size, *facts_from_json(small), small.get("t_offset_us", 0), others)


def read(path: Path, header: Header) -> Iterator[Events]:
    """Read the events of an npz file."""
    width, height = header.size
    with zipfile.ZipFile(path) as archive, ExitStack() as stack:
        entries, length = {}, -1
        for name, expected in _COLUMNS.items():
            entries[name], shape, dtype = stack.enter_context(_opened(archive, name))
            if dtype != expected or len(shape) != 1 or length not in (-1, shape[0]):
                raise EventFormatError(
                    f"entry {name}: found {dtype} of shape {shape}, expected {expected} of shape "
                    f"({'N' if length < 0 else length},)"
                )
            length = shape[0]
        yield no_events(width, height, header.model)
        last_us = np.iinfo(np.int64).min
        for done in range(0, length, batching.PART_EVENTS):
            count = min(batching.PART_EVENTS, length - done)
            columns = {}
            for name, entry in entries.items():
                with reading(f"entry {name}, from event {done}"):
                    data = entry.read(count * _COLUMNS[name].itemsize)
                if len(data) != count * _COLUMNS[name].itemsize:
                    raise EventFormatError(
                        f"entry {name}: ends after event {done}, but should have {length} events"
                    )
                columns[name] = np.frombuffer(data, _COLUMNS[name])
            with reading(f"events from {done}"):
                part = Events(**columns, width=width, height=height, model=header.model)
            if part.t_us[0] < last_us:
                raise EventFormatError(
                    f"event {done}: {part.t_us[0]} us is before the previous time, {last_us} us"
                )
            last_us = int(part.t_us[-1])
            yield part
        for name, entry in entries.items():
            with reading(f"entry {name}"):  # reading to the end checks the checksum
                if entry.read(1):
                    raise EventFormatError(f"found more than {length} values")


def read_triggers(path: Path) -> Triggers:
    """Read the external triggers of an npz file; none if it has no entries of them."""
    with zipfile.ZipFile(path) as archive:
        if not any(f"{name}.npy" in archive.namelist() for name in _TRIGGERS):
            return NO_TRIGGERS
        columns = []
        for name in _TRIGGERS:
            with _opened(archive, name) as (entry, shape, dtype), reading(f"entry {name}"):
                column = np.frombuffer(entry.read(), dtype)
                if column.shape != shape:
                    raise EventFormatError(f"found {len(column)} values, expected shape {shape}")
            columns.append(column)
    return Triggers(*columns)
