"""Rendered clips between runs: bounded, oldest out first, made again when missing."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from eres_render.cache import cache_dir

LIMIT_BYTES = 20_000_000_000
_FREE_SHARE = 1 / 3


def frames_folder(key: str) -> Path:
    """Folder of the frames named by `key`, marked as used just now if it exists."""
    folder = cache_dir() / "frames" / key
    if folder.is_dir():
        os.utime(folder)
    return folder


def make_room(needed_bytes: int, keep: Path) -> None:
    """Remove the clips used longest ago until `needed_bytes` more fit the limit.

    The limit is the smaller of 20 GB and a third of what is free with the cache empty.
    """
    root = cache_dir() / "frames"
    if not root.is_dir():
        return
    sizes = {
        folder: sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        for folder in sorted(root.iterdir(), key=lambda folder: folder.stat().st_mtime)
    }
    used = sum(sizes.values())
    limit = min(LIMIT_BYTES, _FREE_SHARE * (shutil.disk_usage(root).free + used))
    for folder, size in sizes.items():
        if used + needed_bytes <= limit:
            return
        if folder != keep:
            shutil.rmtree(folder, ignore_errors=True)
            used -= size
