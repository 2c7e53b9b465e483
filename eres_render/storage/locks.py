"""Locks between processes. The system releases them when a process ends or is killed."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import filelock

from eres_render.errors import RenderError
from eres_render.storage.atomic import make_folder


class LockedError(Exception):
    """Another process holds a lock."""


@contextmanager
def locked(path: Path, *, shared: bool = False, wait: bool = True) -> Iterator[None]:
    """Hold a lock file, made if necessary; an exclusive holder deletes it on release."""
    with _exclusive(path, wait) if sys.platform == "win32" else _acquired(path, shared, wait):
        try:
            yield
        finally:
            if not shared:
                with suppress(OSError):
                    path.unlink()


def _exclusive(path: Path, wait: bool) -> AbstractContextManager[Any]:
    """Return a held lock; `filelock` has none that is shared, so there holders take turns."""
    make_folder(path.parent)
    try:
        return filelock.FileLock(path).acquire(timeout=-1 if wait else 0)
    except filelock.Timeout:
        raise LockedError(f"{path}: another process holds the lock") from None


def _acquired(path: Path, shared: bool, wait: bool) -> BinaryIO:
    """Return the locked file, which holds the lock until it is closed."""
    import fcntl

    how = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB)
    while True:
        with ExitStack() as stack:
            file = stack.enter_context(_opened(path))
            try:
                fcntl.flock(file, how)
            except BlockingIOError:
                raise LockedError(f"{path}: another process holds the lock") from None
            except OSError as error:  # a file system without locks
                raise RenderError(
                    f"{path.parent}: cannot be locked: {error.strerror}; use a local disk "
                    "(ERES_CACHE names the folder of the cache)"
                ) from error
            if _is_at(path, file):  # or the previous holder deleted the file while we waited
                stack.pop_all()
                return file


def _opened(path: Path) -> BinaryIO:
    make_folder(path.parent)
    try:
        return path.open("a+b")  # a lock over NFS needs both
    except OSError as error:
        raise RenderError(f"{path.parent}: cannot be written: {error.strerror}") from error


def _is_at(path: Path, file: BinaryIO) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
