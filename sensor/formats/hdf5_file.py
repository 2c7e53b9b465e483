"""HDF5 files that can be closed whatever the disk does.

HDF5 cannot let go of a file whose last bytes the disk does not take: it tries again when the
process ends, on memory that it has freed, and that is a segmentation fault. So HDF5 is never told.
What is not taken stays in memory, where HDF5 finds it again, until the file is closed; what went
wrong is raised by us.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sensor.errors import EventFormatError


def load_h5py() -> Any:
    """Return h5py; hdf5plugin adds its filters to it.

    Raises
    ------
    EventFormatError
        One of them is not installed.
    """
    try:
        import h5py
        import hdf5plugin  # noqa: F401
    except ImportError as error:
        raise EventFormatError(
            f"DSEC's HDF5 needs {error.name}, which is not installed: pip install h5py hdf5plugin"
        ) from error
    return h5py


class Storage:
    """The bytes of a file on disk, as h5py's driver for Python objects wants them.

    Nothing fails here but `check`, which must be asked often: from the first failure on, all that
    is written is kept in memory.
    """

    def __init__(self, path: Path, *, new: bool) -> None:
        self._file = path.open("w+b" if new else "r+b", buffering=0)
        self._at = 0
        self._failure: BaseException | None = None
        self._not_taken: list[tuple[int, bytes]] = []  # place and bytes, in order

    def check(self) -> None:
        """Raise what went wrong first, if anything has."""
        if self._failure is not None:
            raise self._failure

    def close(self) -> None:
        """Close the file, which HDF5 has closed before."""
        self._file.close()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place in the file; HDF5 asks for its end only when it opens the file."""
        self._at = offset if whence == os.SEEK_SET else self._file.seek(offset, whence)
        return self._at

    def tell(self) -> int:
        """Return the place in the file."""
        return self._at

    def read(self, size: int) -> bytes:
        """Return bytes from here on."""
        data = bytearray(size)
        self.readinto(data)
        return bytes(data)

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer from here on, with zeros where nothing was written."""
        view = memoryview(buffer)
        view[:] = bytes(len(view))
        self._file.seek(self._at)
        done = 0
        while done < len(view) and (count := self._file.readinto(view[done:])):
            done += count
        end = self._at + len(view)
        for at, data in self._not_taken:
            start, stop = max(at, self._at), min(at + len(data), end)
            if start < stop:
                view[start - self._at : stop - self._at] = data[start - at : stop - at]
        self._at = end
        return len(view)

    def write(self, data: Any) -> int:
        """Write from here on."""
        view = memoryview(data)
        if self._failure is None:
            try:
                self._file.seek(self._at)
                done = 0
                while done < len(view):
                    done += self._file.write(view[done:])
            except BaseException as error:  # Ctrl-C too: to HDF5 it would be a failure
                self._failure = error
        if self._failure is not None:
            self._not_taken.append((self._at, bytes(view)))
        self._at += len(view)
        return len(view)

    def truncate(self, size: int) -> int:
        """Cut the file, or add zeros to it."""
        if self._failure is None:
            try:
                self._file.truncate(size)
            except BaseException as error:
                self._failure = error
        return size

    def flush(self) -> None:
        """Do nothing: nothing is held back."""


@contextmanager
def writable(path: Path, *, new: bool) -> Iterator[tuple[Any, Storage]]:
    """Open an HDF5 file to write, a new one or one that is there; gives `h5py.File` and storage.

    Raises
    ------
    EventFormatError
        h5py or hdf5plugin is not installed.
    OSError
        The disk does not take it; raised by the storage's `check`, or at the end.
    """
    h5py = load_h5py()
    storage = Storage(path, new=new)
    try:
        # From version 1.10 on HDF5 has checksums on its own structures too.
        with h5py.File(storage, "w" if new else "r+", libver=("v110", "v110")) as file:
            yield file, storage
        storage.check()
    finally:
        storage.close()
