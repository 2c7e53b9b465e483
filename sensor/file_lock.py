"""A lock between processes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock


@contextmanager
def locked(path: str | Path) -> Iterator[None]:
    """Hold the lock of a file, which is created if necessary. The lock ends with the process.

    It has no effect on file systems without locks.
    """
    with ExitStack() as stack:
        if Path(path).parent.is_dir():  # which a FileLock would make
            with suppress(OSError, NotImplementedError):
                stack.enter_context(FileLock(path))
        yield
