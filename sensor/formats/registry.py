"""The event formats, and functions that read and write files in any of them."""

from __future__ import annotations

import errno
import itertools
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sensor.errors import EventFormatError
from sensor.events import Events, concatenate
from sensor.formats import dsec, evt, evt2, evt3, npz, text
from sensor.formats.batching import rebatch
from sensor.formats.header import Header, Value

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Format:
    """A file format for events; add one to `FORMATS` to use it everywhere.

    Parameters
    ----------
    name, title
        Short name for options, and name for texts.
    suffixes
        File extensions, with the dot.
    write
        `write(path, header, parts)` writes a stream and returns the number of events.
    read_header
        `read_header(path)` returns the `Header` of a file.
    read
        `read(path, header)` yields the events, at least one part; the header has a size.
    keeps_origin
        Whether the format stores the sensor model and the origin.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Path, Header, Iterable[Events]], int]
    read_header: Callable[[Path], Header]
    read: Callable[[Path, Header], Iterator[Events]]
    keeps_origin: bool = True

    def loses(self, header: Header) -> list[str]:
        """Return the names of the parts of a header that the format does not store."""
        if self.keeps_origin:
            return []
        model = ["sensor model"] if header.model is not None else []
        return [*model, *(["origin"] if header.origin else [])]


def _raw_format(codec: evt.Codec) -> Format:
    return Format(
        codec.name.lower(),
        f"Prophesee {codec.name}",
        (".raw",),
        partial(evt.write, codec=codec),
        partial(evt.read_header, codec=codec),
        partial(evt.read, codec=codec),
    )


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("dsec", "DSEC HDF5", (".h5", ".hdf5"), dsec.write, dsec.read_header, dsec.read),
        _raw_format(evt3.CODEC),
        _raw_format(evt2.CODEC),
        Format("npz", "numpy arrays", (".npz",), npz.write, npz.read_header, npz.read),
        Format(
            "text",
            "text, t x y p",
            (".txt",),
            text.write,
            text.read_header,
            text.read,
            keeps_origin=False,
        ),
    )
}


def find_format(path: str | Path, name: str | None = None, *, new: bool = False) -> Format:
    """Return the format with a name, or the format of a file.

    Parameters
    ----------
    path
        The file. The header of an existing `.raw` file determines its version.
    name
        A name in `FORMATS`; None uses the extension of the file.
    new
        The file will be written, so `.raw` is EVT3.

    Returns
    -------
    Format

    Raises
    ------
    EventFormatError
        The name or the extension is unknown.
    """
    path = Path(path)
    if name is not None:
        if name not in FORMATS:
            raise EventFormatError(f"format: found {name!r}, expected one of {', '.join(FORMATS)}")
        return FORMATS[name]
    suffix = path.suffix.lower()
    if suffix == ".raw" and path.is_file() and not new:
        return FORMATS[evt.read_version(path)]
    for found in FORMATS.values():
        if suffix in found.suffixes:
            return found
    known = ", ".join(sorted({s for f in FORMATS.values() for s in f.suffixes}))
    raise EventFormatError(
        f"{path}: found extension {path.suffix!r}, expected one of {known}, or a format by name "
        f"({', '.join(FORMATS)})"
    )


def write_events(
    path: str | Path,
    parts: Iterable[Events] | Events,
    *,
    format: str | None = None,
    origin: Mapping[str, Value] | None = None,
    t_offset_us: int = 0,
    add: Callable[[Path], object] | None = None,
) -> int:
    """Write a stream to a file, which gets its name only when it is complete.

    Logs a warning with the names of everything that the format does not store.

    Parameters
    ----------
    path
        The file; its extension determines the format: .h5 or .hdf5, .raw (EVT3), .npz, .txt.
    parts
        Consecutive parts of one stream, as from `sensor.stream`, or one `Events`. A few are in
        memory at a time. The file stores their size and model if the format can.
    format
        A name in `FORMATS`; None uses the extension.
    origin
        Other facts about the origin of the events, such as the seed; see `Header`.
    t_offset_us
        Start of the clock of the events. DSEC files store it, and EVT files if the times are too
        large for their words. The times of `parts` are absolute in any case.
    add
        Function that is called with the file before it gets its name, to add data.

    Returns
    -------
    int
        Number of events.

    Raises
    ------
    EventFormatError
        The format cannot store these events, or the parts are not one stream.
    OSError
        The file cannot be written; the error names it.
    """
    path = Path(path)
    chosen = find_format(path, format, new=True)
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "no such folder", str(path.parent))
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a folder", str(path))
    batches = rebatch((parts,) if isinstance(parts, Events) else parts)
    first = next(batches)
    header = Header(first.width, first.height, first.model, dict(origin or {}), t_offset_us)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        count = chosen.write(unfinished, header, itertools.chain([first], batches))
        if add is not None:
            add(unfinished)
        os.replace(unfinished, path)
    except OSError as error:
        if error.filename not in (None, str(unfinished)):
            raise
        raise _named(error, path) from error
    finally:
        unfinished.unlink(missing_ok=True)
    warn_of_loss(path, chosen, chosen.loses(header))
    return count


def _named(error: OSError, path: Path) -> OSError:
    """Return the error with the name of the file, which errors of reads and writes lack."""
    return OSError(error.errno or errno.EIO, error.strerror or str(error), str(path))


def warn_of_loss(path: Path, format: Format, names: Sequence[str]) -> None:
    """Warn that a format does not store something.

    Parameters
    ----------
    path, format
        The file and its format.
    names
        Names of the lost parts; no warning if empty.
    """
    if names:
        _log.warning("%s: %s cannot store %s", path, format.title, ", ".join(names))


def read_header(path: str | Path, *, format: str | None = None) -> Header:
    """Read the header of a file.

    Parameters
    ----------
    path
        The file.
    format
        A name in `FORMATS`; None uses the extension, or the header of a .raw file.

    Returns
    -------
    Header

    Raises
    ------
    EventFormatError
        The file is damaged or has another format; the text says where.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    path.open("rb").close()  # raises the error of the system if it is missing or not allowed
    chosen = find_format(path, format)
    try:
        return chosen.read_header(path)
    except EventFormatError as error:
        raise EventFormatError(f"{path}: {error}") from error


def read_events(
    path: str | Path, *, format: str | None = None, size: tuple[int, int] | None = None
) -> Iterator[Events]:
    """Read a file in parts; memory does not depend on its size.

    Parameters
    ----------
    path
        The file.
    format
        A name in `FORMATS`; None uses the extension, or the header of a .raw file.
    size
        (width, height) of the sensor, for files that do not store it.

    Returns
    -------
    iterator of Events
        At least one part, each with the model that the file stores; the first may be empty.

    Raises
    ------
    EventFormatError
        The file is damaged or has another format, or its size is neither stored nor given. Damage
        after the header is raised when the iteration reaches it, never skipped.
    OSError
        The file cannot be read.
    """
    path = Path(path)
    header = read_header(path, format=format)
    try:
        header = header.with_size(size)
    except EventFormatError as error:
        raise EventFormatError(f"{path}: {error}") from error
    return _parts(path, find_format(path, format), header)


def _parts(path: Path, chosen: Format, header: Header) -> Iterator[Events]:
    try:
        yield from chosen.read(path, header)
    except EventFormatError as error:
        raise EventFormatError(f"{path}: {error}") from error
    except OSError as error:
        raise _named(error, path) from error


def load_events(
    path: str | Path, *, format: str | None = None, size: tuple[int, int] | None = None
) -> Events:
    """Read a whole file into memory.

    Parameters
    ----------
    path, format, size
        As in `read_events`.

    Returns
    -------
    Events

    Raises
    ------
    EventFormatError, OSError
        As in `read_events`.
    """
    return concatenate(list(read_events(path, format=format, size=size)))
