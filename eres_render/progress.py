"""Progress of long work: libraries report it, the command line draws it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called during long work: the stage in words, the amount done, and the total."""

    def __call__(self, stage: str, done: float, total: float, /) -> None: ...


def silent(stage: str, done: float, total: float, /) -> None:
    """Ignore progress."""
