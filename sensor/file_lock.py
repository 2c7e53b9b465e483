"""A lock between processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path


@contextmanager
def locked(path: str | Path) -> Iterator[None]:
    """Hold the lock of a file, which is created if necessary. The lock ends with the process.

    It has no effect on file systems without locks, and on Windows.
    """
    with ExitStack() as stack:
        with suppress(OSError, ImportError):
            import fcntl

            file = stack.enter_context(open(path, "ab"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
