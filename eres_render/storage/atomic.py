"""Files that appear under their names only when they are whole."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from eres_render.errors import RenderError


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file by way of a temporary name beside it.

    Parameters
    ----------
    write
        Called with the temporary name.

    Raises
    ------
    RenderError
        If the folder or the disk does not take it; nothing is left behind.
    """
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        write(unfinished)
        os.replace(unfinished, path)
    except (RuntimeError, OSError) as error:  # the OpenEXR library raises RuntimeError
        unfinished.unlink(missing_ok=True)
        reason = error.strerror if isinstance(error, OSError) else error
        raise RenderError(f"{path}: cannot be written: {reason}") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file whole or not at all; see `write_whole`."""
    write_whole(path, lambda unfinished: unfinished.write_text(text, encoding="utf-8"))
