"""Files that appear under their names only when they are complete.

`eres_render.storage.atomic` has the same, as neither package imports the other.
"""

from __future__ import annotations

import errno
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from sensor.file_lock import locked


@contextmanager
def new_file(path: Path, *, overwrite: bool) -> Iterator[Path]:
    """Yield a temporary file name in the folder of `path`; afterwards rename that file to `path`.

    A file beside it is locked meanwhile, by which commands tell it from what a killed process left.
    The file itself is not, as libraries such as HDF5 lock what they write.
    """
    # Threads share a process id, and so may processes of machines that share a folder; names may be
    # long.
    host = platform.node().partition(".")[0][:20]
    process = f"{host}.{os.getpid()}.{uuid4().hex[:8]}"
    unfinished = path.with_name(f".{path.name[:48]}.{process}.unfinished")
    lock = unfinished.with_suffix(".lock")
    try:
        with locked(lock):
            yield unfinished
            if overwrite:
                os.replace(unfinished, path)
            else:
                _give_new_name(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)
        lock.unlink(missing_ok=True)


def _give_new_name(unfinished: Path, path: Path) -> None:
    try:
        os.link(unfinished, path)  # unlike a rename, replaces no file
    except OSError:
        if os.path.lexists(path):
            raise FileExistsError(
                errno.EEXIST, "appeared meanwhile and is kept; the new file is removed", str(path)
            ) from None
        os.rename(unfinished, path)  # on a file system without links
