"""What scores are of: metrics, and series of one method on one task."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from tasks.registry import TASKS
from tasks.study.results.words import number_text


@dataclass(frozen=True, slots=True)
class Metric:
    """How a metric is named, printed and compared."""

    label: str
    unit: str
    higher_is_better: bool
    negligible: float  # a difference of this size or less makes no difference in practice
    decimals: int
    reference_width_px: int | None = None  # normalised to it; None: does not scale with the width
    digits: int | None = None  # significant ones, for values that span decades

    @property
    def sign(self) -> float:
        """Factor on a score that makes more of it better."""
        return 1.0 if self.higher_is_better else -1.0

    @property
    def arrow(self) -> str:
        """Which way is better."""
        return "↑" if self.higher_is_better else "↓"

    def text(self, value: float, sign: str = "") -> str:
        """Format a value or a difference of this metric, without its unit."""
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
"""Our changes to methods of the paper, and to which."""


class Series(NamedTuple):
    """A method on a task, judged by a metric: what one table or one plot shows."""

    task: str
    method: str
    metric: str
    variant: str = ""  # of the task; "" is the usual one

    @property
    def title(self) -> str:
        """Task, method and variant in words, as in "reconstruction by event integration"."""
        return f"{TASKS[self.task].title} by {self.name}"

    @property
    def name(self) -> str:
        """Method and variant in words."""
        method = method_label(self.method)
        return f"{method}, {self.variant}" if self.variant else method

    @property
    def of_paper(self) -> bool:
        """Whether it is a method as the paper has it, or a user's own; not our change to one."""
        return not self.variant and self.method not in EXTENSIONS


def method_label(method: str) -> str:
    """A method's name in words; one from outside the project keeps its ``module:function``."""
    if ":" in method:
        return method
    words = method.replace("_", " ").replace("high pass", "high-pass")
    return words.replace("no event decay", "without event decay")
