"""Which formats there are, and reading and writing in whichever a file's name asks for."""

from __future__ import annotations

import errno
import itertools
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sensor.errors import EventFormatError
from sensor.events import Events, concatenate
from sensor.formats import dsec, evt, evt2, evt3, npz, text
from sensor.formats.batching import rebatch
from sensor.formats.header import Header, Value

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Format:
    """One way to keep events in a file.

    `write(path, header, parts)` returns the number of events; `read(path, header)` yields at least
    one part and needs a header with a size.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    write: Callable[[Path, Header, Iterable[Events]], int]
    read_header: Callable[[Path], Header]
    read: Callable[[Path, Header], Iterator[Events]]
    keeps_origin: bool = True  # and the sensor model

    def loses(self, header: Header) -> list[str]:
        """Return names of what a header says and such a file cannot."""
        if self.keeps_origin:
            return []
        model = ["sensor model"] if header.model is not None else []
        return [*model, *(["origin"] if header.origin else [])]


FORMATS: dict[str, Format] = {
    f.name: f
    for f in (
        Format("dsec", "DSEC HDF5", (".h5", ".hdf5"), dsec.write, dsec.read_header, dsec.read),
        Format("evt3", "Prophesee EVT3", (".raw",), evt3.write, evt3.read_header, evt3.read),
        Format("evt2", "Prophesee EVT2", (".raw",), evt2.write, evt2.read_header, evt2.read),
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
    """The format called `name`, or else the one that the file's name, or its header, stands for.

    A `.raw` file that exists is of the version that its header says; a new one, which may replace
    it, is EVT3.

    Raises
    ------
    EventFormatError
        There is none of that name or for that extension.
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
    """Write a stream to a file, which appears under its name only when it is whole.

    A warning names what the format cannot hold.

    Parameters
    ----------
    path
        Its extension chooses the format: .h5 or .hdf5, .raw (EVT3), .npz, .txt.
    parts
        Consecutive parts of one stream, as `sensor.stream` yields them, or one `Events`. A few are
        in memory at a time. Their size and model are stored with them, where the format can.
    format
        A name in `FORMATS`, in place of the extension's.
    origin
        What else to store on how the events were made, such as the seed; see `Header`.
    t_offset_us
        Where the events' own clock starts, if that is not 0: a DSEC file says so, and an EVT file
        of times that its words cannot hold. The times of `parts` are absolute all the same.
    add
        Called with the file before it gets its name, to add to it.

    Returns
    -------
    Number of events written.

    Raises
    ------
    EventFormatError
        The format cannot hold these events, or the parts are not one stream.
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
    """The same error with the file's name, which those of reading and writing lack."""
    return OSError(error.errno or errno.EIO, error.strerror or str(error), str(path))


def warn_of_loss(path: Path, format: Format, names: Sequence[str]) -> None:
    """Warn that something is not in a file, since its format has no place for it."""
    if names:
        _log.warning(
            "%s: without %s, for which %s has no place", path, ", ".join(names), format.title
        )


def read_header(path: str | Path, *, format: str | None = None) -> Header:
    """What a file says besides its events.

    Raises
    ------
    EventFormatError
        The file is damaged or of another format; the text says where.
    OSError
        It cannot be read.
    """
    path = Path(path)
    path.open("rb").close()  # the system's own words for what is missing or not allowed
    chosen = find_format(path, format)
    try:
        return chosen.read_header(path)
    except EventFormatError as error:
        raise EventFormatError(f"{path}: {error}") from error


def read_events(
    path: str | Path, *, format: str | None = None, size: tuple[int, int] | None = None
) -> Iterator[Events]:
    """Read a file part by part, in memory that does not grow with it.

    Parameters
    ----------
    path
        The file; its extension, or for .raw its header, says the format.
    format
        A name in `FORMATS`, in place of the extension's.
    size
        (width, height) of the sensor, for files that do not store it.

    Returns
    -------
    At least one part, each with the model that the file stores; the first may be empty.

    Raises
    ------
    EventFormatError
        The file is damaged, of another format, or its size is neither stored nor given. What is
        wrong beyond the header is raised when the iteration comes to it, never passed over.
    OSError
        It cannot be read.
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
    """Read a whole file into memory; parameters and errors as for `read_events`."""
    return concatenate(list(read_events(path, format=format, size=size)))
