"""Locks between processes. The system lets go of them when a process ends, also a killed one."""

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
    """Hold a lock on a file that is there for this alone.

    Parameters
    ----------
    path
        The file; made, with its folder, if need be. Who held it alone removes it.
    shared
        Hold it beside others who share it, not alone.
    wait
        Wait until it is free.

    Raises
    ------
    BlockingIOError
        It is not free, and was not to be waited for.
    RenderError
        The file cannot be made.
    """
    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    how = kind if wait else kind | fcntl.LOCK_NB
    while True:
        with _opened(path) as file:
            fcntl.flock(file, how)
            if not _is_at(path, file):
                continue  # who held it removed it while we waited
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
        return path.open("a+b")  # over NFS a lock needs both
    except OSError as error:
        raise RenderError(f"{path.parent}: cannot be written: {error.strerror}") from error


def _is_at(path: Path, file: BinaryIO) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
