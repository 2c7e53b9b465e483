"""Write files that appear under their names only when they are complete."""

from __future__ import annotations

import logging
import os
import platform
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from eres_render.errors import RenderError

_log = logging.getLogger(__name__)


def make_folder(folder: Path) -> None:
    """Make a folder and those that hold it, unless they exist."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        file = next(path for path in (folder, *folder.parents) if path.exists())
        raise RenderError(f"{file}: found a file, expected a folder") from error
    except OSError as error:
        raise RenderError(f"{folder}: cannot be written: {error.strerror}") from error


@contextmanager
def unfinished(path: Path, *, folder: bool = False) -> Iterator[Path]:
    """Yield a temporary name beside `path`, or a new folder of it, and remove it at the end.

    A lock file beside it is locked meanwhile: `clear_unfinished` removes both after a process was
    killed. The temporary file is not locked, as libraries such as HDF5 lock what they write.
    """
    # Threads share a process id, and so may processes of machines that share a folder; names may be
    # long.
    process = f"{_machine()}.{os.getpid()}.{uuid4().hex[:8]}"
    new = path.with_name(f".{path.name[:48]}.{process}.unfinished")
    lock = new.with_suffix(".lock")
    try:
        with ExitStack() as held:
            with suppress(OSError, ImportError):
                held.enter_context(_locked(lock, "ab"))
            if folder:
                new.mkdir()
            yield new
    finally:
        _remove(new)
        _remove(lock)


def clear_unfinished(folder: Path, name: str | None = None) -> None:
    """Remove temporary files of killed processes; warn of files that may still be written."""
    inside = folder.rglob if name is None else folder.glob
    of_name = ".+" if name is None else re.escape(name[:48])
    for lock in list(inside(".*.lock")):
        match = re.fullmatch(rf"\.{of_name}\.([^.]*)\.(\d+)\.[0-9a-f]{{8}}\.lock", lock.name)
        if match is None:
            continue
        machine, process = match.groups()
        new = lock.with_suffix(".unfinished")
        try:
            with _locked(lock, "r+b"):
                if machine == _machine():
                    _remove(new)
                    _remove(lock)
                    continue
        except (BlockingIOError, FileNotFoundError):  # it is being written, or was finished
            continue
        except (OSError, ImportError):
            pass
        left = "%s: left by process %s on %s; remove it if that process has ended"
        _log.warning(left, new, process, machine)


def remove_unfinished(folder: Path) -> None:
    """Remove all temporary files in a folder to which no other process writes."""
    for new in (*folder.rglob(".*.unfinished"), *folder.rglob(".*.lock")):
        _remove(new)


def _machine() -> str:
    return platform.node().partition(".")[0][:20]


@contextmanager
def _locked(path: Path, mode: str) -> Iterator[None]:
    """Lock a file; an ImportError on Windows, which has no such locks."""
    import fcntl

    with path.open(mode) as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


def _remove(new: Path) -> None:
    if new.is_dir():
        shutil.rmtree(new, ignore_errors=True)
    else:
        new.unlink(missing_ok=True)


@contextmanager
def new_file(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Yield a temporary file beside `path`, and rename it at the end; a link is replaced."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise RenderError(f"{path}: found a device or a pipe, expected a file or a new name")
    make_folder(path.parent)
    new = None
    try:
        with unfinished(path) as new:
            yield new
            if overwrite:
                os.replace(new, path)
            else:
                _give_new_name(new, path)
    except OSError as error:
        if error.filename is not None and new is not None and str(error.filename) != str(new):
            raise  # about another file, such as one that was read in the context
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error


def _give_new_name(new: Path, path: Path) -> None:
    try:
        os.link(new, path)  # unlike a rename, replaces no file
    except OSError:
        if os.path.lexists(path):
            raise RenderError(
                f"{path}: appeared meanwhile and is kept; the new file is removed"
            ) from None
        os.rename(new, path)  # on a file system without links


def write_bytes(path: Path, data: bytes | memoryview, *, overwrite: bool = True) -> None:
    """Write a file under a temporary name in its folder, then rename it."""
    with new_file(path, overwrite=overwrite) as new:
        new.write_bytes(data)


def encoded(text: str) -> bytes:
    """Return a text in UTF-8; lone surrogates, as of names of other encodings, become escapes."""
    return text.encode(errors="backslashreplace")


def write_text(path: Path, text: str, *, overwrite: bool = True) -> None:
    """Write a text file in UTF-8; see `write_bytes`."""
    write_bytes(path, encoded(text), overwrite=overwrite)
