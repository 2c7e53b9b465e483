"""Writing files that appear under their names only when they are whole."""

from __future__ import annotations

import os
from pathlib import Path

from tasks.errors import TaskError


def check_new(path: Path, overwrite: bool) -> None:
    """Refuse to replace a file, unless that was asked for.

    Raises
    ------
    TaskError
        It exists.
    """
    if os.path.lexists(path) and not path.is_dir() and not overwrite:
        raise TaskError(f"{path}: exists already; add --overwrite to replace it")


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file by way of a temporary name beside it; its folder is made if need be.

    Raises
    ------
    OSError
        The folder or the disk does not take it. It names the file, and nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        partial.write_bytes(data)
        os.replace(partial, path)
    except OSError as error:  # one from a full disk names no file
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        partial.unlink(missing_ok=True)
