"""The HDF5 layout of DSEC, for its `EventSlicer` and all code that uses it.

    events/t    uint32, microseconds since t_offset; int64 if t_offset is not 0, because
                `t + t_offset` in DSEC's slicer overflows 32 bits with NumPy 2
    events/x    uint16          events/y    uint16          events/p    uint8, 0 or 1
    t_offset    int64, microseconds
    ms_to_idx   uint64, t[ms_to_idx[ms]] >= 1000 ms and t[ms_to_idx[ms] - 1] < 1000 ms, for every
                whole millisecond from 0 to that of the last event
    triggers/t_us, channel, p       int64, absolute; uint8; int8, +1 or -1: if there are triggers

Columns are shuffled, compressed with zstd at level 1, and have checksums. Attributes of the file
are `width`, `height`, and as JSON `origin` and, if the events have a model, `sensor_model`.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.events import Events, no_events
from sensor.formats import batching
from sensor.formats.hdf5_file import check_stored, load_h5py, text_of, writable
from sensor.formats.header import Header, facts_from_json, facts_to_json
from sensor.formats.triggers import NO_TRIGGERS, Triggers

TITLE = "DSEC HDF5"
_CHUNK_EVENTS = 1 << 16
_COLUMNS: dict[str, type] = {"t": np.uint32, "x": np.uint16, "y": np.uint16, "p": np.uint8}
_ATTRIBUTES = ("width", "height", "sensor_model", "origin")
_PLACES = ("events", "t_offset", "ms_to_idx")
_TRIGGERS = ("t_us", "channel", "p")
_MAX_SPAN_US = 1 << 32
_MAX_INDEXED_US = 1 << 38  # 3 days
# Largest first time relative to t_offset. Later times would soon overflow uint32, so t_offset is
# set to a time just before them.
_MAX_START_US = 1 << 31
_MAX_OFFSET_US = 1 << 62


def write(path: Path, header: Header, parts: Iterable[Events]) -> int:
    """Write a DSEC file."""
    h5py = load_h5py()
    import hdf5plugin

    with writable(path, new=True) as (file, storage):
        file.attrs["width"] = header.width
        file.attrs["height"] = header.height
        for name, text in facts_to_json(header).items():
            # Texts have a fixed length: HDF5 has no checksum for texts of variable length.
            file.attrs[name] = np.bytes_(text.encode())

        options = {"maxshape": (None,), "chunks": (_CHUNK_EVENTS,), "shuffle": True}
        options |= {"fletcher32": True, **hdf5plugin.Zstd(clevel=1)}

        def create(name: str, dtype: type) -> Any:
            return file.create_dataset(name, (0,), dtype, **options)

        parts = storage.each(parts)
        first = next(parts)
        start_us = int(first.t_us[0]) if len(first) else header.t_offset_us
        offset_us = _offset_us(start_us, header.t_offset_us)
        dtypes = _COLUMNS | ({"t": np.int64} if offset_us else {})
        columns = {name: create(f"events/{name}", dtype) for name, dtype in dtypes.items()}
        ms_to_idx = create("ms_to_idx", np.uint64)
        count = 0
        for part in itertools.chain([first] if len(first) else [], parts):
            last_us = int(part.t_us[-1]) - offset_us
            limit_us = _MAX_INDEXED_US if offset_us else _MAX_SPAN_US
            if last_us >= limit_us:
                raise EventFormatError(
                    f"DSEC: events last until {last_us} us after t_offset, but the limit is "
                    f"{limit_us} us; split the recording"
                )
            t = part.t_us - offset_us
            last_ms = last_us // 1000
            for start_ms in range(len(ms_to_idx), last_ms + 1, batching.PART_EVENTS):
                stop_ms = min(start_ms + batching.PART_EVENTS, last_ms + 1)
                whole_ms = np.arange(start_ms, stop_ms)
                _append(ms_to_idx, count + np.searchsorted(t, 1000 * whole_ms))
            _append(columns["t"], t)
            _append(columns["x"], part.x)
            _append(columns["y"], part.y)
            _append(columns["p"], part.p > 0)
            count += len(part)
        if len(header.triggers):
            for name in _TRIGGERS:
                column = getattr(header.triggers, name)
                _append(create(f"triggers/{name}", column.dtype), column)
        # Stored in the header of the dataset, which has a checksum.
        compact = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        compact.set_layout(h5py.h5d.COMPACT)
        compact.set_obj_track_times(False)  # the file must depend on its events only
        scalar = h5py.h5s.create(h5py.h5s.SCALAR)
        t_offset = h5py.h5d.create(file.id, b"t_offset", h5py.h5t.STD_I64LE, scalar, compact)
        t_offset.write(h5py.h5s.ALL, h5py.h5s.ALL, np.array(offset_us, np.int64))
    return count


def end_us(start_us: int, t_offset_us: int) -> int:
    """Return the exclusive upper bound on event times, us."""
    offset_us = _offset_us(start_us, t_offset_us)
    return offset_us + (_MAX_INDEXED_US if offset_us else _MAX_SPAN_US)


def _offset_us(start_us: int, offset_us: int) -> int:
    """Return the given offset if it suits the events, or else a time just before them."""
    if not 0 <= start_us - offset_us < _MAX_START_US:
        offset_us = start_us // 1000 * 1000
    if abs(offset_us) >= _MAX_OFFSET_US:
        raise EventFormatError(
            f"DSEC: the first event is at {start_us} us, expected within 2^62 us of 0"
        )
    return offset_us


def _append(dataset: Any, values: np.ndarray) -> None:
    start = len(dataset)
    dataset.resize((start + len(values),))
    dataset[start:] = values.astype(dataset.dtype)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    with load_h5py().File(path, "r") as file:
        yield file


def read_header(path: Path) -> Header:
    """Read size, model, origin and t_offset; the files of DSEC itself have only t_offset."""
    with _opened(path) as file:
        stored: dict[str, Any] = {}
        for name in _ATTRIBUTES:
            with reading(f"attribute {name}"):
                if name in file.attrs:
                    value = file.attrs[name]
                    stored[name] = _whole(value) if name in ("width", "height") else _text(value)
        offset_us = _read_offset_us(file)
        places = (*_PLACES, "triggers") if _has_triggers(file) else _PLACES
        others = (*_strangers(file.attrs, _ATTRIBUTES), *_strangers(file, places))
        if isinstance(file.get("events"), load_h5py().Group):
            others += tuple(f"events/{name}" for name in _strangers(file["events"], _COLUMNS))
    size = stored.get("width"), stored.get("height")
    return Header(*size, *facts_from_json(stored), offset_us, others)


def _strangers(names: Iterable[str | bytes], known: Container[str]) -> Iterator[str]:
    return (name for name in map(text_of, names) if name not in known)


def _read_offset_us(file: Any) -> int:
    with reading("t_offset"):
        if "t_offset" not in file:
            return 0
        check_stored(file["t_offset"])
        offset_us = _whole(file["t_offset"][()])
        if abs(offset_us) >= _MAX_OFFSET_US:
            raise EventFormatError(f"found {offset_us} us, expected within 2^62 us of 0")
        return offset_us


def _whole(value: Any) -> int:
    if not np.isfinite(value) or int(value) != value:
        raise EventFormatError(f"found {value}, expected a whole number")
    return int(value)


def _text(value: Any) -> str:
    return value.decode("utf-8") if isinstance(value, bytes) else str(value)


def read(path: Path, header: Header) -> Iterator[Events]:
    """Read the events of a DSEC file; t_offset is added to the times."""
    width, height = header.size
    with _opened(path) as file:
        columns = {name: integers(file, f"events/{name}") for name in _COLUMNS}
        with reading("events"):
            check_stored(*columns.values())
        length = len(columns["t"])
        for name, column in columns.items():
            if len(column) != length:
                raise EventFormatError(
                    f"events/{name}: has {len(column)} entries, but events/t has {length}"
                )
        offset_us = _read_offset_us(file)
        yield no_events(width, height, header.model)
        last_us = np.iinfo(np.int64).min
        for start in range(0, length, batching.PART_EVENTS):
            stop = min(start + batching.PART_EVENTS, length)
            values = {}
            for name, column in columns.items():
                with reading(f"events/{name}, entries {start} to {stop}"):
                    values[name] = column[start:stop]
            part = checked(values, start, offset_us, header)
            if part.t_us[0] < last_us:
                raise EventFormatError(
                    f"events/t, entry {start}: its time, {part.t_us[0]} us, is before the previous "
                    f"time, {last_us} us"
                )
            last_us = int(part.t_us[-1])
            yield part


def read_triggers(path: Path) -> Triggers:
    """Read the external triggers of a DSEC file; none if no group `triggers` has any."""
    with _opened(path) as file:
        if not _has_triggers(file):
            return NO_TRIGGERS
        columns = [integers(file, f"triggers/{name}") for name in _TRIGGERS]
        with reading("triggers"):
            check_stored(*columns)
            return Triggers(*(column[:] for column in columns))


def _has_triggers(file: Any) -> bool:
    """Return whether a file has triggers as we write them, not other data of that name."""
    group = file.get("triggers")
    return isinstance(group, load_h5py().Group) and any(name in group for name in _TRIGGERS)


def integers(file: Any, name: str) -> Any:
    """Return a 1-D dataset of integers."""
    with reading(name):
        if name not in file:
            raise EventFormatError("missing")
        column = file[name]
        if getattr(column, "ndim", None) != 1 or column.dtype.kind not in "uib":
            raise EventFormatError(f"found {column}, expected a 1-D data set of integers")
        return column


def checked(values: dict[str, np.ndarray], start: int, offset_us: int, header: Header) -> Events:
    """Convert a part to `Events` and check its values."""
    width, height = header.size
    limits = {"t": 1 << 62, "x": width, "y": height, "p": 2}
    for name, limit in limits.items():
        column = values[name]
        for wrong in (int(column.min()), int(column.max())):
            if not 0 <= wrong < limit:
                k = start + int(np.argmax(column == wrong))
                raise EventFormatError(
                    f"events/{name}, entry {k}: found {wrong}, expected 0 to {limit - 1}"
                )
    with reading(f"events from {start}"):
        return Events(
            values["t"].astype(np.int64) + offset_us,
            values["x"].astype(np.uint16),
            values["y"].astype(np.uint16),
            (2 * values["p"].astype(np.int8) - 1).astype(np.int8),
            *header.size,
            header.model,
        )
