"""HDF5 files that close also after a failed write or a signal.

If the last write to a file fails, HDF5 cannot close it: it tries again when the process ends, on
freed memory, which crashes the process. So HDF5 never sees a failed write. After the first one, all
writes stay in memory, where HDF5 reads them, until the file is closed; then the error is raised.
Signals wait until HDF5 has returned.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from sensor.formats.held_signals import HeldSignals, held_signals
from sensor.growth import check_growth

_Part = TypeVar("_Part")


def load_h5py() -> Any:
    """Return h5py with the filters of hdf5plugin."""
    import h5py
    import hdf5plugin  # noqa: F401

    return h5py


def check_stored(*datasets: Any) -> None:
    """Refuse datasets that are not stored: HDF5 reads what was never written as zeros."""
    declared = 0
    for data in datasets:
        chunks = data.chunks or data.shape  # a chunk is decompressed as a whole
        sides = zip(data.shape, chunks, strict=True)
        counts = (-(-side // chunk) for side, chunk in sides if chunk)
        declared += math.prod(counts) * math.prod(chunks) * data.dtype.itemsize
    check_growth(declared, sum(data.id.get_storage_size() for data in datasets))


def text_of(name: str | bytes) -> str:
    """Return a name in an HDF5 file, which h5py gives as bytes if it is not UTF-8."""
    return name.decode("utf-8", "replace") if isinstance(name, bytes) else name


class Storage:
    """A file on disk as a file object for h5py; only `check` and `each` raise errors.

    Write in parts, since all writes after a failure stay in memory.
    """

    def __init__(self, path: Path, signals: HeldSignals, *, new: bool) -> None:
        self._signals = signals
        self._file = path.open("w+b" if new else "r+b", buffering=0)
        self._at = 0
        self._failure: BaseException | None = None
        self._not_taken: list[tuple[int, bytes]] = []  # position and bytes, in order

    def check(self) -> None:
        """Raise the first failure, if there is one."""
        if self._failure is not None:
            raise self._failure

    def each(self, parts: Iterable[_Part]) -> Iterator[_Part]:
        """Yield what is to be written part by part, and end at the first failure or signal.

        Signals are handled before each part and while it is made.
        """
        source = iter(parts)
        while True:
            self.check()
            with self._signals.let_in():
                try:
                    part = next(source)
                except StopIteration:
                    return
            yield part

    def close(self) -> None:
        """Close the file after HDF5 has closed it."""
        self._file.close()

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Set the position in the file."""
        self._at = offset if whence == os.SEEK_SET else self._file.seek(offset, whence)
        return self._at

    def tell(self) -> int:
        """Return the position in the file."""
        return self._at

    def read(self, size: int) -> bytes:
        """Read bytes from the position."""
        data = bytearray(size)
        self.readinto(data)
        return bytes(data)

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer from the position, with zeros where nothing was written."""
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
        """Write at the position."""
        view = memoryview(data)
        if self._failure is None:
            try:
                self._file.seek(self._at)
                done = 0
                while done < len(view):
                    done += self._file.write(view[done:])
            except BaseException as error:
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
        """Do nothing, since writes are not buffered."""


@contextmanager
def writable(path: Path, *, new: bool) -> Iterator[tuple[Any, Storage]]:
    """Open an HDF5 file to write; signals are held, except where `Storage.each` makes a part."""
    h5py = load_h5py()
    with held_signals() as signals:
        storage = Storage(path, signals, new=new)
        try:
            # Since version 1.10 HDF5 has checksums for its own structures too.
            with h5py.File(storage, "w" if new else "r+", libver=("v110", "v110")) as file:
                yield file, storage
            storage.check()
        finally:
            storage.close()
