"""Series: the scores of one method on one task."""

from __future__ import annotations

from typing import NamedTuple

from tasks.registry import TASKS


class Series(NamedTuple):
    """A method on a task with a metric. One table or one plot shows one series."""

    task: str
    method: str
    metric: str
    variant: str = ""  # variant of the task; "" is the usual one

    @property
    def title(self) -> str:
        """Task, method and variant in words: "reconstruction by event integration"."""
        return f"{TASKS[self.task].title} by {self.name}"

    @property
    def name(self) -> str:
        """Method and variant in words."""
        method = TASKS[self.task].label(self.method)
        return f"{method}, {self.variant}" if self.variant else method

    @property
    def is_method(self) -> bool:
        """Whether this estimates from events: not a baseline, and nothing that gets the truth."""
        return TASKS[self.task].method(self.method).role == "method"

    @property
    def of_paper(self) -> bool:
        """Whether this is a method of the paper or of a user, not our variant of one."""
        ours = self.variant or TASKS[self.task].method(self.method).ours
        return not ours and self.is_method
