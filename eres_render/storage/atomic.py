"""Write files that appear under their names only when they are complete."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from eres_render.errors import RenderError


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Yield a temporary file name in the folder of `path`; afterwards rename that file to `path`.

    Raises
    ------
    RenderError
        If the file cannot be written. Nothing is left behind, also after any other error.
    """
    # Threads share a process id, and so may processes of machines that share a folder; names may be
    # long.
    unfinished = path.with_name(f".{path.name[:48]}.{os.getpid()}.{uuid4().hex[:8]}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error
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
