"""Existing files are replaced only on request."""

from __future__ import annotations

import os
from pathlib import Path

from tasks.errors import TaskError


def check_new(path: Path, overwrite: bool) -> None:
    """Refuse to replace a file.

    Parameters
    ----------
    path
        The file to write.
    overwrite
        Whether it may be replaced.

    Raises
    ------
    TaskError
        It exists, and may not be replaced.
    """
    if os.path.lexists(path) and not path.is_dir() and not overwrite:
        raise TaskError(f"{path}: exists already; add --overwrite to replace it")
