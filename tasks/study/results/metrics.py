"""Metrics, and series: the scores of one method on one task."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from tasks.registry import TASKS
from tasks.study.results.words import number_text


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric: its name, its format, and which scores are better."""

    label: str
    unit: str
    higher_is_better: bool
    negligible: float  # a difference of this size or less does not matter in practice
    decimals: int
    reference_width_px: int | None = None  # scores are normalized to this width; None: they are not
    digits: int | None = None  # significant digits, for values that span decades

    @property
    def sign(self) -> float:
        """Factor that makes larger scores better: 1 or -1."""
        return 1.0 if self.higher_is_better else -1.0

    @property
    def arrow(self) -> str:
        """Arrow that points to better scores."""
        return "↑" if self.higher_is_better else "↓"

    def text(self, value: float, sign: str = "") -> str:
        """Format a score or a difference of scores, without the unit.

        Parameters
        ----------
        value
            Score or difference, in the metric's unit.
        sign
            "+" prints a plus sign too.

        Returns
        -------
        str
            With a true minus sign.
        """
        decimals = self.decimals
        if self.digits is not None and value:
            before = math.floor(math.log10(abs(value))) + 1
            decimals = min(max(self.digits - before, 0), decimals)
        return number_text(value, decimals, sign)


METRICS = {
    "psnr_db": Metric("PSNR", "dB", True, negligible=0.1, decimals=2),
    "rnepe_px": Metric("RNEPE", "px", False, negligible=0.05, decimals=2, reference_width_px=1280),
    "position_error_mm": Metric("position error", "mm", False, 0.1, decimals=2, digits=3),
}


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
