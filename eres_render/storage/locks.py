"""Locks between processes. The system releases them when a process ends or is killed."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from eres_render.errors import RenderError


@contextmanager
def locked(path: Path, *, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Hold a lock, in a context.

    Parameters
    ----------
    path
        The lock file, which is made if necessary. An exclusive holder deletes it on release.
    shared
        Hold the lock together with other shared holders, not exclusively.
    wait
        Wait until the lock is free.

    Returns
    -------
    A context manager that holds the lock.

    Raises
    ------
    BlockingIOError
        The lock is held and `wait` is False.
    RenderError
        The file cannot be made.
    """
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    how = kind if wait else kind | fcntl.LOCK_NB
    while True:
        with _opened(path) as file:
            fcntl.flock(file, how)
            if not _is_at(path, file):
                continue  # the previous holder deleted the file while we waited
            try:
                yield
            finally:
                if not shared:
                    with suppress(OSError):
                        path.unlink()
            return


def _opened(path: Path) -> BinaryIO:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("a+b")  # a lock over NFS needs both
    except OSError as error:
        raise RenderError(f"{path.parent}: cannot be written: {error.strerror}") from error


def _is_at(path: Path, file: BinaryIO) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
