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
from sensor.formats.header import (
    Header,
    model_from_json,
    model_to_json,
    origin_from_json,
    origin_to_json,
)
from sensor.formats.triggers import NO_TRIGGERS, Triggers
from sensor.growth import check_growth

_COLUMNS: dict[str, np.dtype[Any]] = {
    "t_us": np.dtype("<i8"),
    "x": np.dtype("<u2"),
    "y": np.dtype("<u2"),
    "p": np.dtype("i1"),
}
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
        texts = {"origin": origin_to_json(header.origin)}
        if header.model is not None:
            texts["sensor_model"] = model_to_json(header.model)
        scalars = {"width": header.width, "height": header.height, **texts}
        if header.t_offset_us:
            scalars["t_offset_us"] = header.t_offset_us
        triggers = {
            name: getattr(header.triggers, name.removeprefix("trigger_")) for name in _TRIGGERS
        }
        for name, value in (scalars | (triggers if len(header.triggers) else {})).items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy", _DATE), "w") as entry:
                np.lib.format.write_array(entry, np.asarray(value), allow_pickle=False)
        for name, file in spilled.items():
            described = {
                "descr": np.lib.format.dtype_to_descr(_COLUMNS[name]),
                "fortran_order": False,
                "shape": (count,),
            }
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
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(entry)
            if fortran and len(shape) > 1:
                raise EventFormatError(f"found shape {shape} in Fortran order, expected C order")
        yield entry, shape, dtype


def _read_scalar(archive: zipfile.ZipFile, name: str, kind: str) -> object:
    """Read a number or text without dimensions; None if no entry has the name."""
    if f"{name}.npy" not in archive.namelist():
        return None
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
        width, height = (_read_scalar(archive, name, "iu") for name in ("width", "height"))
        model, origin = (_read_scalar(archive, name, "U") for name in ("sensor_model", "origin"))
        t_offset_us = _read_scalar(archive, "t_offset_us", "iu")
        names = [name.removesuffix(".npy") for name in archive.namelist()]
    return Header(
        width if isinstance(width, int) else None,
        height if isinstance(height, int) else None,
        model_from_json(model) if isinstance(model, str) else None,
        origin_from_json(origin) if isinstance(origin, str) else {},
        t_offset_us if isinstance(t_offset_us, int) else 0,
        others=tuple(name for name in names if name not in _ENTRIES),
    )


def read(path: Path, header: Header) -> Iterator[Events]:
    """Read the events of an npz file."""
    width, height = header.size
    with zipfile.ZipFile(path) as archive, ExitStack() as stack:
        entries = {}
        length = None
        for name, expected in _COLUMNS.items():
            entries[name], shape, dtype = stack.enter_context(_opened(archive, name))
            wrong_length = length is not None and shape != (length,)
            if dtype != expected or len(shape) != 1 or wrong_length:
                raise EventFormatError(
                    f"entry {name}: found {dtype} of shape {shape}, expected {expected} of shape "
                    f"({'N' if length is None else length},)"
                )
            length = shape[0]
        yield no_events(width, height, header.model)
        done = 0
        last_us = np.iinfo(np.int64).min
        while done < (length or 0):
            count = min(batching.PART_EVENTS, (length or 0) - done)
            columns = {}
            for name, entry in entries.items():
                with reading(f"entry {name}, from event {done}"):
                    data = entry.read(count * _COLUMNS[name].itemsize)
                if len(data) != count * _COLUMNS[name].itemsize:
                    raise EventFormatError(
                        f"entry {name}: ends after event {done}, expected {length}"
                    )
                columns[name] = np.frombuffer(data, _COLUMNS[name])
            with reading(f"events from {done}"):
                part = Events(**columns, width=width, height=height, model=header.model)
            if part.t_us[0] < last_us:
                raise EventFormatError(
                    f"event {done}: found time {part.t_us[0]} us after {last_us} us"
                )
            last_us = int(part.t_us[-1])
            done += count
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
                    raise EventFormatError(f"found {len(column)} values, expected {shape}")
            columns.append(column)
    return Triggers(*columns)
