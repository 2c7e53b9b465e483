"""What a scorer is, and its scores.

A scorer belongs to one sensor. It takes in the sensor's events batch by batch, keeps what its task
needs, and turns that into scores at the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from sensor import Events


@dataclass(frozen=True, slots=True)
class Score:
    """Score of one method on one item, in the task's metric.

    Parameters
    ----------
    method, value, variant, item, failure
        As in `Row`.
    sample
        As in `Row`; None for the number of the clip.
    events
        Number of events that the method got.
    cpu_s
        CPU time of the method, seconds.
    copied
        Whether the answer is that of another variant, where its time is counted.
    metric
        Name of the metric; "" for that of the task.
    t_us
        Time of an image in the time of the events; 0 for the end of the window.
    """

    method: str
    value: float
    variant: str = ""
    item: int = 0
    failure: str = ""
    sample: int | None = None
    events: int = 0
    cpu_s: float = 0.0
    copied: bool = False
    metric: str = ""
    t_us: int = 0


class Scorer(Protocol):
    """Scores the methods of one task on the events of a `Source`; made from it and the settings."""

    def push(self, events: Events) -> None:
        """Take in the next events, those of the warm-up included."""

    def scores(self) -> Iterator[Score]:
        """Yield the scores of every method, after the last event; runs in a thread."""
