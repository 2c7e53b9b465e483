"""Write files that appear under their names only when they are complete."""

from __future__ import annotations

import os
from pathlib import Path

from eres_render.errors import RenderError


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
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            unfinished.write_bytes(data)
            os.replace(unfinished, path)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise RenderError(f"{path}: cannot be written: {error.strerror}") from error


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8; see `write_bytes`.

    Parameters
    ----------
    path
        The file; its folder is made if necessary.
    text
        Its content.
    """
    write_bytes(path, text.encode())
