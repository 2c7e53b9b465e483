"""A bounded cache of rendered clips; the least recently used are deleted first.

Several processes may use the cache at once: a clip in use is not deleted.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eres_render.storage.cache import cache_dir
from eres_render.storage.locks import LockedError, locked

LIMIT_BYTES = 20_000_000_000
_FREE_SHARE = 1 / 3


@contextmanager
def frames_folder(key: str, needed_bytes: int) -> Iterator[Path]:
    """Open the folder of a clip; no process deletes its frames within the context.

    A clip that is not in the cache gets `needed_bytes` freed.
    """
    folder = _root() / key
    with locked(_lock_file(folder), shared=True):
        if folder.is_dir():
            os.utime(folder)  # now the clip used last
        else:
            make_room(needed_bytes)
        yield folder


def make_room(needed_bytes: int) -> None:
    """Delete the least recently used clips until `needed_bytes` fit; keep those in use."""
    sizes = _clips()
    limit, used = limit_bytes(), sum(sizes.values())
    for folder, size in sizes.items():
        if used + needed_bytes <= limit:
            return
        with suppress(LockedError), locked(_lock_file(folder), wait=False):
            shutil.rmtree(folder, ignore_errors=True)
            used -= size


def limit_bytes() -> float:
    """Return the limit of the cache: 20 GB, or a third of what is free without it, if less."""
    existing = next(folder for folder in (_root(), *_root().parents) if folder.is_dir())
    free = shutil.disk_usage(existing).free + sum(_clips().values())
    return min(LIMIT_BYTES, _FREE_SHARE * free)


def _root() -> Path:
    return cache_dir() / "frames"


def _clips() -> dict[Path, int]:
    """Return the clips and their sizes in bytes, the least recently used first."""
    used_s = {}
    for folder in _root().glob("*/"):
        with suppress(FileNotFoundError):  # another process has just deleted it
            used_s[folder] = folder.stat().st_mtime
    return {folder: _bytes_in(folder) for folder in sorted(used_s, key=used_s.__getitem__)}


def _lock_file(folder: Path) -> Path:
    return folder.with_name(f".{folder.name}.lock")


def _bytes_in(folder: Path) -> int:
    total = 0
    for parent, _, names in os.walk(folder):
        for name in names:
            with suppress(FileNotFoundError):
                total += os.stat(os.path.join(parent, name)).st_size
    return total
