"""What scores mean, and how they are printed."""

from __future__ import annotations

import math
from dataclasses import dataclass

LAST_BITS = 1e-9
"""Upper bound on the rounding differences of equal scores, which are about 1e-15."""

MIN_SAMPLES_FOR_INTERVAL = 6
"""With 6 or more samples, the smallest and the largest enclose the median with 95 % probability;
with fewer, no interval between samples does."""


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric: its name, its format, and which scores are better."""

    name: str  # as in `Row.metric`
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

    @property
    def heading(self) -> str:
        """Its label, unit and arrow."""
        return f"{self.label} [{self.unit}] {self.arrow}"

    @property
    def near(self) -> str:
        """The negligible difference, with its unit."""
        return f"{self.negligible:g} {self.unit}"

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


def number_text(value: float, decimals: int, sign: str = "", *, keeps_minus: bool = False) -> str:
    """Format a number with a true minus sign, and without one on zero.

    With `keeps_minus`, a negative number that rounds to zero is "−0.00", unless it is only the
    rounding error of a difference.
    """
    z = "" if keeps_minus and abs(value) > LAST_BITS else "z"
    return f"{value:{sign}{z}.{decimals}f}".replace("-", "−")
