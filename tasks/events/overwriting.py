"""Existing files are replaced only on request, and devices never."""

from __future__ import annotations

import os
from pathlib import Path

from tasks.errors import TaskError


def check_new(path: Path, overwrite: bool, *sources: Path) -> None:
    """Refuse to replace a file, a file that is read, or something other than a file.

    A link is replaced, not what it points to.

    Parameters
    ----------
    path
        The file to write.
    overwrite
        Whether it may be replaced.
    *sources
        Files that are read while it is written.

    Raises
    ------
    TaskError
        It exists, and may not be replaced, or is one of the sources, a device or a pipe.
    """
    for source in sources:
        if path.exists() and source.exists() and path.samefile(source):
            raise TaskError(
                f"{path}: is the input {source}, which cannot be replaced while it is read"
            )
    if os.path.lexists(path) and not path.is_dir():
        if not overwrite:
            raise TaskError(f"{path}: exists already; add --overwrite to replace it")
        if path.exists() and not path.is_file():
            raise TaskError(f"{path}: found a device or a pipe, expected a file or a new name")
