"""Write files that appear under their names only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from eres_render.errors import RenderError


def make_folder(folder: Path) -> None:
    """Make a folder and those that hold it, unless they exist.

    Parameters
    ----------
    folder
        The folder.

    Raises
    ------
    RenderError
        If a file is in the way, or the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        file = next(one for one in (folder, *folder.parents) if one.exists())
        raise RenderError(f"{file}: found a file, expected a folder") from error
    except OSError as error:
        raise RenderError(f"{folder}: cannot be written: {error.strerror}") from error


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Yield a temporary file name in the folder of `path`; afterwards rename that file to `path`.

    A link is replaced, not what it points to.

    Raises
    ------
    RenderError
        If the file cannot be written, or is a device or a pipe. Nothing is left behind, also after
        any other error.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise RenderError(f"{path}: found a device or a pipe, expected a file or a new name")
    # Threads share a process id, and so may processes of machines that share a folder; names may be
    # long.
    unfinished = path.with_name(f".{path.name[:48]}.{os.getpid()}.{uuid4().hex[:8]}.unfinished")
    make_folder(path.parent)
    try:
        yield unfinished
        os.replace(unfinished, path)
    except OSError as error:
        if error.filename is not None and str(error.filename) != str(unfinished):
            raise  # about another file, such as one that was read in the context
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes | memoryview) -> None:
    """Write a file under a temporary name in its folder, then rename it.

    Parameters
    ----------
    path
        The file; its folder is made if necessary.
    data
        Its content.

    Raises
    ------
    RenderError
        If the file cannot be written; nothing is left behind.
    """
    with new_file(path) as unfinished:
        unfinished.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8; see `write_bytes`.

    Parameters
    ----------
    path
        The file; its folder is made if necessary.
    text
        Its content.

    Raises
    ------
    RenderError
        If the file cannot be written.
    """
    write_bytes(path, text.encode())
