"""Progress of long work: libraries report it, the command line draws it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called during long work: the stage in words, the amount done, and the total."""

    def __call__(self, stage: str, done: float, total: float, /) -> None: ...


def silent(stage: str, done: float, total: float, /) -> None:
    """Ignore progress."""


def cost(disk_bytes: float, seconds: float) -> str:
    """Return disk space and time in words."""
    disk = f"{disk_bytes / 1e9:.2g} GB"
    if disk_bytes < 1e9:
        disk = f"{max(1.0, disk_bytes / 1e6):.0f} MB"
    fits = ((unit_s, unit) for unit_s, unit in ((3600, "h"), (60, "min")) if seconds >= 3 * unit_s)
    unit_s, unit = next(fits, (1, "s"))
    return f"{disk} on disk, {max(1, round(seconds / unit_s))} {unit}"
