"""The event formats, and functions that read and write files in any of them."""

from __future__ import annotations

import errno
import itertools
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sensor.errors import EventFormatError, reading
from sensor.events import Events, concatenate
from sensor.formats import aedat3, dsec, evt, evt2, evt3, faery_files, npz, ros_bag, text
from sensor.formats.batching import rebatch
from sensor.formats.header import Header, Value
from sensor.formats.new_file import new_file
from sensor.formats.triggers import NO_TRIGGERS, Triggers
from sensor.own_modules import WithInstalled, import_own, installed

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Format:
    """A file format for events; add one to `FORMATS` to use it everywhere.

    Parameters
    ----------
    name, title
        Short name for options, and name for messages.
    suffixes
        File extensions, with the dot.
    write
        `write(path, header, parts)` writes a stream and returns the number of events. None if the
        format can only be read.
    read_header
        `read_header(path)` returns the `Header` of a file. If `topic` is an option, it may be given
        too.
    read
        `read(path, header, **options)` yields the events in one or more parts. The header has a
        size.
    keeps_origin
        Whether the format stores the sensor model, the origin and, where times need it, the start
        of the clock.
    read_triggers
        `read_triggers(path)` returns the `Triggers` of a file; None if the format has none.
    options
        Names of the options that `read` takes, of time_unit, sort and topic.
    end_us
        `end_us(start_us, t_offset_us)` returns the exclusive upper bound on event times for a file
        whose first event is at start_us, on a clock that starts at t_offset_us. None if the bound
        is beyond 2^62 us.

    Examples
    --------
    >>> from sensor.formats import FORMATS
    >>> [name for name, format in FORMATS.items() if format.write]  # the others are read only
    ['dsec', 'evt3', 'evt2', 'npz', 'text']
    >>> FORMATS["text"].suffixes, FORMATS["text"].keeps_origin
    (('.txt',), False)
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Path, Header, Iterable[Events]], int] | None
    read_header: Callable[..., Header]
    read: Callable[..., Iterator[Events]]
    keeps_origin: bool = True
    read_triggers: Callable[[Path], Triggers] | None = None
    options: tuple[str, ...] = ()
    end_us: Callable[[int, int], int] | None = None

    def loses(self, header: Header) -> list[str]:
        """Return the names of the parts of a header that the format does not store."""
        parts = {
            "sensor model": header.model is not None and not self.keeps_origin,
            "origin": bool(header.origin) and not self.keeps_origin,
            "triggers": len(header.triggers) > 0 and self.read_triggers is None,
            "start of the clock": bool(header.t_offset_us) and not self.keeps_origin,
        }
        return [name for name, lost in parts.items() if lost]


def _format(module: Any, name: str, title: str, *suffixes: str, **rest: Any) -> Format:
    """Return a format whose functions are those of a module."""
    roles = "write", "read_header", "read", "read_triggers", "end_us"
    functions: dict[str, Any] = {role: getattr(module, role, None) for role in roles}
    return Format(name, title, suffixes, **(functions | rest))


def _raw_format(codec: evt.Codec) -> Format:
    functions = {
        role: partial(getattr(evt, role), codec=codec)
        for role in ("write", "read_header", "read", "read_triggers")
    }
    name = codec.name
    return _format(evt, name.lower(), f"Prophesee {name}", ".raw", **functions)


def _faery_format(name: str, title: str, *suffixes: str) -> Format:
    functions = {
        role: partial(getattr(faery_files, role), kind=name) for role in ("read_header", "read")
    }
    return _format(faery_files, name, title, *suffixes, **functions, options=("sort",))


_TIMED = "time_unit", "sort"
_FORMATS = {
    f.name: f
    for f in (
        _format(dsec, "dsec", dsec.TITLE, ".h5", ".hdf5"),
        _raw_format(evt3.CODEC),
        _raw_format(evt2.CODEC),
        _format(npz, "npz", "numpy arrays", ".npz"),
        _format(text, "text", "text, t x y p", ".txt", keeps_origin=False, options=_TIMED),
        _format(text, "csv", "text, t,x,y,p", ".csv", write=None, options=_TIMED),
        _faery_format("aedat4", "AEDAT 4", ".aedat4", ".aedat"),
        _format(aedat3, "aedat3", "AEDAT 3.1", options=("sort",)),
        _faery_format("dat", "Prophesee DAT", ".dat"),
        _faery_format("es", "Event Stream", ".es"),
        _format(ros_bag, "bag", "ROS bag", ".bag", options=("sort", "topic")),
    )
}


def _installed_formats() -> dict[str, Format]:
    return {name: _own_format(place) for name, place in installed("eres.formats").items()}


FORMATS = WithInstalled(_FORMATS, _installed_formats)


def find_format(path: str | Path, name: str | None = None, *, new: bool = False) -> Format:
    """Return the format with a name, or the format of a file.

    Parameters
    ----------
    path
        The file. The header of an existing `.raw` file determines its version.
    name
        A name in `FORMATS`, or "package.module:Format" for your own `Format` or a function that
        returns it. None uses the extension of the file.
    new
        The file will be written: `.raw` is then EVT3.

    Returns
    -------
    Format

    Raises
    ------
    EventFormatError
        The name or the extension is unknown, or `new` is set and the format can only be read.

    Examples
    --------
    >>> from sensor.formats import find_format
    >>> find_format("recording.hdf5").title
    'DSEC HDF5'
    >>> find_format("recording.raw", new=True).title, find_format("recording.raw", "evt2").title
    ('Prophesee EVT3', 'Prophesee EVT2')
    """
    path = Path(path)
    chosen = _named(name) if name is not None else _by_suffix(path, new)
    if new and chosen.write is None:
        raise EventFormatError(
            f"{path}: {chosen.title} can only be read; formats to write are "
            f"{', '.join(f.name for f in FORMATS.values() if f.write)}"
        )
    return chosen


def _named(name: str) -> Format:
    if ":" in name:
        return _own_format(name)
    if name not in FORMATS:
        raise EventFormatError(
            f"format: found {name!r}, expected one of {', '.join(FORMATS)}, or your own as "
            "package.module:Format"
        )
    return FORMATS[name]


def _own_format(name: str) -> Format:
    module, _, attribute = name.partition(":")
    try:
        own = getattr(import_own(module), attribute)
        own = own if isinstance(own, Format) else own()
        if not isinstance(own, Format):
            raise TypeError(
                f"found {type(own).__name__}, expected a sensor.formats.Format, or a function that "
                "returns a Format"
            )
        return own
    except Exception as error:  # a user's module may raise anything
        raise EventFormatError(f"format {name!r}: {type(error).__name__}: {error}") from error


def _by_suffix(path: Path, new: bool) -> Format:
    suffix = path.suffix.lower()
    if suffix == ".raw" and path.is_file() and not new:
        return FORMATS[evt.read_version(path)]
    if suffix == ".aedat" and path.is_file():
        with path.open("rb") as file:
            if file.read(len(aedat3.MAGIC)) == aedat3.MAGIC:
                return FORMATS["aedat3"]
    for known in FORMATS.values():
        if suffix in known.suffixes:
            return known
    able = [known for known in FORMATS.values() if known.write or not new]
    suffixes = ", ".join(sorted({suffix for known in able for suffix in known.suffixes}))
    raise EventFormatError(
        f"{path}: found extension {path.suffix!r}, expected one of {suffixes}, or a format by name "
        f"({', '.join(known.name for known in able)})"
    )


def write_events(
    path: str | Path,
    parts: Iterable[Events] | Events,
    *,
    format: str | None = None,
    origin: Mapping[str, Value] | None = None,
    t_offset_us: int = 0,
    triggers: Triggers = NO_TRIGGERS,
    add: Callable[[Path], object] | None = None,
    overwrite: bool = True,
) -> int:
    """Write a stream to a file, which gets its name only when it is complete.

    Logs a warning with the names of everything that the format does not store.

    Parameters
    ----------
    path
        The file; its extension determines the format: .h5 or .hdf5, .raw (EVT3), .npz, .txt.
    parts
        Consecutive parts of one stream, as from `sensor.stream`, or one `Events`. Only a few parts
        are in memory at a time. The file stores their size and model if the format can.
    format
        A name in `FORMATS`; None uses the extension.
    origin
        Further facts about the events, such as the seed; see `Header`.
    t_offset_us
        Start of the clock of the events. DSEC files store it, and so do EVT files if the times are
        too large for their words. The times of `parts` are always absolute.
    triggers
        External triggers, on the clock of the events.
    add
        Called with the finished file before it gets its name, to add data.
    overwrite
        Whether to replace an existing file once the new file is complete.

    Returns
    -------
    int
        Number of events.

    Raises
    ------
    EventFormatError
        The format cannot store these events, or the parts are not one stream.
    OSError
        The file cannot be written, or it exists and `overwrite` is False; the error names it.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.formats import load_events, read_header, write_events
    >>> pixel, p = np.array([3, 4], np.uint16), np.array([1, -1], np.int8)
    >>> events = Events(np.array([10, 25]), pixel, pixel, p, width=346, height=260)
    >>> write_events("written.h5", events, origin={"lens": "8 mm"})
    2
    >>> load_events("written.h5")
    Events(2 of 346x260 px, 10..25 us)
    >>> read_header("written.h5").origin
    {'lens': '8 mm'}
    """
    path = Path(path)
    chosen = find_format(path, format, new=True)
    for number, refused, reason, file in (
        (errno.ENOENT, not path.parent.is_dir(), "no such folder", path.parent),
        (errno.EISDIR, path.is_dir(), "is a folder", path),
        (errno.EEXIST, path.exists() and not path.is_file(), "is a device or a pipe", path),
        (errno.EEXIST, path.exists() and not overwrite, "already exists", path),
    ):
        if refused:
            raise OSError(number, reason, str(file))  # of the class that belongs to the number
    of_input: list[Exception] = []
    batches = rebatch(_noting((parts,) if isinstance(parts, Events) else parts, of_input))
    first = next(batches)
    facts = first.width, first.height, first.model, dict(origin or {}), t_offset_us
    header = Header(*facts, triggers=triggers)
    assert chosen.write is not None  # as `find_format` has checked
    try:
        with new_file(path, overwrite=overwrite) as unfinished:
            count = chosen.write(unfinished, header, itertools.chain([first], batches))
            if add is not None:
                add(unfinished)
    except OSError as error:
        if error in of_input or error.filename not in (None, str(unfinished)):
            raise
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
    except EventFormatError as error:
        if error in of_input:
            raise
        raise EventFormatError(f"{path}: {error}") from error
    warn_of_loss(path, chosen, chosen.loses(header))
    return count


def _noting(parts: Iterable[Events], errors: list[Exception]) -> Iterator[Events]:
    """Yield the parts; note an error that ends them, which is not about the new file."""
    try:
        yield from parts
    except (EventFormatError, OSError) as error:
        errors.append(error)
        raise


def warn_of_loss(path: Path, format: Format, names: Sequence[str]) -> None:
    """Warn that a format does not store something."""
    if names:
        _log.warning("%s: the format '%s' cannot store %s", path, format.title, ", ".join(names))


def read_header(path: str | Path, *, format: str | None = None, topic: str | None = None) -> Header:
    """Read the header of a file.

    Parameters
    ----------
    path
        The file.
    format
        A name in `FORMATS`; None uses the extension, or the header of a .raw file.
    topic
        Topic of a ROS bag: the header then has its size, and lists the other topics.

    Returns
    -------
    Header

    Raises
    ------
    EventFormatError
        The file is damaged or has another format; the message says where.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import SensorModel, simulate
    >>> from sensor.formats import read_header, write_events
    >>> frames = np.exp(np.arange(3.0))[:, None, None] * np.ones((4, 6))
    >>> model = SensorModel(width=6, height=4, contrast_threshold=0.25)
    >>> count = write_events("simulated.npz", simulate(frames, [0.0, 0.1, 0.2], model))
    >>> header = read_header("simulated.npz")
    >>> header.width, header.height, header.model.contrast_threshold
    (6, 4, 0.25)
    """
    path = Path(path)
    path.open("rb").close()  # raises OSError if the file is missing or not readable
    chosen = find_format(path, format)
    with reading(path, chosen.title):
        if topic is not None and "topic" in chosen.options:
            return chosen.read_header(path, topic=topic)
        return chosen.read_header(path)


def read_triggers(path: str | Path, *, format: str | None = None) -> Triggers:
    """Read the external triggers of a file; formats without triggers give none.

    All triggers are in memory at once. An EVT file is read as a whole.

    Parameters
    ----------
    path
        The file.
    format
        As in `read_header`.

    Returns
    -------
    Triggers

    Raises
    ------
    EventFormatError
        The file is damaged.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.formats import Triggers, read_triggers, write_events
    >>> pixel, p = np.array([3, 4], np.uint16), np.array([1, -1], np.int8)
    >>> events = Events(np.array([10, 25]), pixel, pixel, p, width=346, height=260)
    >>> edges = Triggers(np.array([12, 20]), np.zeros(2, np.uint8), np.array([1, -1], np.int8))
    >>> write_events("triggered.raw", events, triggers=edges)
    2
    >>> read_triggers("triggered.raw").t_us
    array([12, 20])
    """
    path = Path(path)
    chosen = find_format(path, format)
    path.open("rb").close()  # raises OSError if the file is missing or not readable
    if chosen.read_triggers is None:
        return NO_TRIGGERS
    with reading(path, chosen.title):
        return chosen.read_triggers(path)


def read_events(
    path: str | Path,
    *,
    format: str | None = None,
    size: tuple[int, int] | None = None,
    time_unit: str | None = None,
    sort: bool = False,
    topic: str | None = None,
) -> Iterator[Events]:
    """Read a file in parts; memory does not depend on its size, unless `sort` is set.

    Parameters
    ----------
    path
        The file.
    format
        A name in `FORMATS`, or "package.module:Format"; None uses the extension, or the header of a
        .raw file.
    size
        (width, height) of the sensor, for files that do not store it.
    time_unit
        Unit of the times of a text file: s, ms, us or ns. The default is the unit in the file's
        line of names, or else s.
    sort
        Sort the events by time, for text, CSV, AEDAT, DAT, ES and bags. All events are then in
        memory.
    topic
        Topic of a ROS bag, if several topics have events.

    Returns
    -------
    iterator of Events
        At least one part, each with the model that the file stores; the first may be empty.

    Raises
    ------
    EventFormatError
        The file is damaged or has another format, or its size is neither stored nor given. Damage
        after the header is never skipped: the iteration raises when it reaches the damage.
    OSError
        The file cannot be read.

    Examples
    --------
    A text file with times in microseconds that does not store the size of the sensor:

    >>> import numpy as np
    >>> from sensor.formats import read_events
    >>> np.savetxt("recording.txt", [(1500, 12, 40, 1), (2000, 13, 40, 0)], fmt="%d")
    >>> parts = read_events("recording.txt", size=(346, 260), time_unit="us")
    >>> sum(len(events) for events in parts)
    2
    """
    path = Path(path)
    header = read_header(path, format=format, topic=topic)
    chosen = find_format(path, format)
    options = {"time_unit": time_unit, "sort": sort, "topic": topic}
    given = {name: value for name, value in options.items() if value}
    with reading(path):
        header = header.with_size(size)
        for name in given:
            if name not in chosen.options:
                reason = {
                    "topic": "has only one stream",
                    "time_unit": "states its own time unit",
                    "sort": "must already be in time order",
                }[name]
                raise EventFormatError(
                    f"{name}: found {given[name]!r}, but {chosen.title} {reason}"
                )
    return _parts(path, chosen, header, given)


def _parts(
    path: Path, chosen: Format, header: Header, options: Mapping[str, object]
) -> Iterator[Events]:
    with reading(path, chosen.title):
        yield from chosen.read(path, header, **options)


def load_events(
    path: str | Path,
    *,
    format: str | None = None,
    size: tuple[int, int] | None = None,
    time_unit: str | None = None,
    sort: bool = False,
    topic: str | None = None,
) -> Events:
    """Read a whole file into memory.

    Parameters
    ----------
    path, format, size, time_unit, sort, topic
        As in `read_events`.

    Returns
    -------
    Events

    Raises
    ------
    EventFormatError, OSError
        As in `read_events`.

    Examples
    --------
    >>> import numpy as np
    >>> from sensor.formats import load_events
    >>> np.savetxt("seconds.txt", [(0.0015, 12, 40, 1), (0.002, 13, 40, 0)], fmt="%g")
    >>> load_events("seconds.txt", size=(346, 260))
    Events(2 of 346x260 px, 1500..2000 us)
    """
    parts = read_events(path, format=format, size=size, time_unit=time_unit, sort=sort, topic=topic)
    return concatenate(list(parts))
