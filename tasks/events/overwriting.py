"""Existing files are replaced only on request, and devices never."""

from __future__ import annotations

import os
from pathlib import Path

from eres_render.storage.atomic import clear_unfinished
from tasks.errors import TaskError

# Kinds of files that a folder of frames has; files of events may lie beside them.
_OF_FRAMES = {".json", ".exr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".csv", ".txt"}


def check_new(path: Path, overwrite: bool, *sources: Path) -> None:
    """Refuse to replace a file, a file that is read, or something other than a file.

    A link is replaced, not its target. What a killed process left of the file is removed, or named
    in a warning.
    """
    clear_unfinished(path.parent, path.name)
    for source in sources:
        if path.exists() and source.exists() and _is_read(path, source):
            raise TaskError(f"{path}: would overwrite the input {source}; choose another name")
    if os.path.lexists(path) and not path.is_dir():
        if not overwrite:
            raise TaskError(f"{path}: already exists; add --overwrite to replace it")
        if path.exists() and not path.is_file():
            raise TaskError(f"{path}: is a device or a pipe; choose another name")


def _is_read(path: Path, source: Path) -> bool:
    """Return whether a file is a source, or one of a folder of frames."""
    if source.is_dir():
        return source.resolve() in path.resolve().parents and path.suffix.lower() in _OF_FRAMES
    return path.samefile(source)
