"""Rendered clips between runs: bounded, oldest out first, made again when missing.

Any number of processes may use the cache at once: a clip that one of them uses stays.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eres_render.storage.cache import cache_dir
from eres_render.storage.locks import locked

LIMIT_BYTES = 20_000_000_000
_FREE_SHARE = 1 / 3


@contextmanager
def frames_folder(key: str, needed_bytes: int) -> Iterator[Path]:
    """Folder of the frames named by `key`, which stay as long as the context does.

    Parameters
    ----------
    needed_bytes
        How much room to make for them, if they are not there.
    """
    folder = _root() / key
    with locked(_lock_file(folder), shared=True):
        if folder.is_dir():
            os.utime(folder)  # used just now
        else:
            make_room(needed_bytes)
        yield folder


def make_room(needed_bytes: int) -> None:
    """Remove the clips used longest ago, but for those in use, until `needed_bytes` more fit.

    The limit is the smaller of 20 GB and a third of what is free with the cache empty.
    """
    root = _root()
    if not root.is_dir():
        return
    sizes = {folder: _bytes_in(folder) for folder in _oldest_first(root)}
    used = sum(sizes.values())
    limit = min(LIMIT_BYTES, _FREE_SHARE * (shutil.disk_usage(root).free + used))
    for folder, size in sizes.items():
        if used + needed_bytes <= limit:
            return
        with suppress(BlockingIOError), locked(_lock_file(folder), wait=False):
            shutil.rmtree(folder, ignore_errors=True)
            used -= size


def _root() -> Path:
    return cache_dir() / "frames"


def _lock_file(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.lock")


def _oldest_first(root: Path) -> list[Path]:
    used_s = {}
    for folder in root.iterdir():
        with suppress(FileNotFoundError):  # another process has just removed it
            if folder.is_dir():
                used_s[folder] = folder.stat().st_mtime
    return sorted(used_s, key=used_s.__getitem__)


def _bytes_in(folder: Path) -> int:
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):
                total += os.stat(os.path.join(parent, name)).st_size
    return total
