"""Progress of long work: libraries report it, the command line draws it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called with the work in words, how much of it is done, and how much there is."""

    def __call__(self, stage: str, done: float, total: float, /) -> None: ...


def silent(stage: str, done: float, total: float, /) -> None:
    """Ignore progress."""
