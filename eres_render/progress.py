"""Progress of long work: libraries report it, the command line draws it."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """Called as long work goes on, with what is done in words, how much of it, and of how much."""

    def __call__(self, stage: str, done: float, total: float, /) -> None: ...


def silent(stage: str, done: float, total: float, /) -> None:
    """Ignore progress.

    Parameters
    ----------
    stage, done, total
        As a `Progress` takes them.
    """
