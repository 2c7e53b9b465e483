"""From events to scores, one file for each task.

A scorer watches one sensor. It receives all its events, batch by batch as they are simulated, keeps
what its task needs of them, and turns that into scores at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from sensor import Events


@dataclass(frozen=True, slots=True)
class Score:
    """What a scorer says of one method on one item; with a setting it makes a `Row`."""

    task: str
    method: str
    metric: str
    value: float
    variant: str = ""
    item: int = 0
    failure: str = ""
    sample: int | None = None  # where it is not the job's
    events: int = 0  # that the method was given for it
    cpu_s: float = 0.0  # of its thread, for it
    copied: bool = False  # from another variant, that is the same here


class Scorer(Protocol):
    """Watches one sensor for one task."""

    def push(self, events: Events) -> None:
        """Take in the next events, those of the warm-up included."""

    def scores(self) -> Iterator[Score]:
        """Score every method, after the last event. Runs beside other scorers, in a thread."""
