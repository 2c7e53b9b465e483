"""Metrics, and series: the scores of one method on one task."""

from __future__ import annotations

from typing import NamedTuple

from tasks.metric import Metric
from tasks.registry import TASKS

METRICS: dict[str, Metric] = {spec.metric.name: spec.metric for spec in TASKS.values()}
"""The metric of each task, by name."""

EXTENSIONS = {
    "photometric_flow_unknown_contrast": "photometric_flow",
    "high_pass_filter_no_event_decay": "high_pass_filter",
    "photometric_flow_with_delay": "photometric_flow",
    "photometric_tracking_with_delay": "photometric_tracking",
}
"""Our variants of the paper's methods, each with the method that it changes."""


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
        method = method_label(self.method)
        return f"{method}, {self.variant}" if self.variant else method

    @property
    def of_paper(self) -> bool:
        """Whether this is a method of the paper or of a user, not our variant of one."""
        return not self.variant and self.method not in EXTENSIONS


def method_label(method: str) -> str:
    """Return a method's name in words; a ``module:function`` stays as it is."""
    if ":" in method:
        return method
    words = method.replace("_", " ").replace("high pass", "high-pass")
    return words.replace("no event decay", "without event decay")
