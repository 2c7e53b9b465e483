"""Compute intervals of statistics of medians by a percentile bootstrap over samples.

The bootstrap is paired: all cells of a scene are resampled with the same sample indices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tasks.metric import number_text
from tasks.study.results.scores import Cell

MIN_SAMPLES_FOR_INTERVAL = 6
"""With 6 or more samples, the smallest and the largest enclose the median with 95 % probability;
with fewer, no interval between samples does."""


Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A statistic of medians with its 95 % interval.

    `low` and `high` are None if the samples are too few for an interval.
    """

    value: float
    low: float | None
    high: float | None

    def includes(self, bound: float) -> bool:
        """Whether the interval, if there is one, reaches to both sides of a bound."""
        return self.low is not None and self.high is not None and self.low <= bound <= self.high

    def text(self, decimals: int = 2, sign: str = "+", unit: str = "") -> str:
        """Format as ``+3.18 [+2.90, +3.40] dB``.

        Parameters
        ----------
        decimals
            Number of decimals.
        sign
            "+" prints plus signs; "" prints minus signs only.
        unit
            Unit to append; can be empty.

        Returns
        -------
        str
            Value, with its interval if there is one.
        """

        def number(value: float) -> str:
            return number_text(value, decimals, sign)

        unit = f" {unit}" if unit else ""
        if self.low is None or self.high is None:
            return f"{number(self.value)}{unit}"
        return f"{number(self.value)} [{number(self.low)}, {number(self.high)}]{unit}"


def estimate(
    cells: Mapping[Key, Cell],
    statistic: Callable[[Mapping[Key, np.ndarray]], np.ndarray],
    *,
    of_rates: bool = False,
) -> Estimate:
    """Evaluate a statistic of medians, with a percentile bootstrap interval over samples.

    Parameters
    ----------
    cells
        Complete cells by any key; cells of one scene have the same samples.
    statistic
        Function of the medians by key, each an array of any shape; returns the same shape.
    of_rates
        Whether to use medians of event rates in place of scores.

    Returns
    -------
    Estimate
        The scene's name seeds the draws, so order has no effect. There is no interval if a cell has
        fewer than `MIN_SAMPLES_FOR_INTERVAL` samples.
    """
    value = float(
        statistic(
            {
                where: np.array(cell.event_rate_hz if of_rates else cell.median)
                for where, cell in cells.items()
            }
        )
    )
    if min(cell.samples for cell in cells.values()) < MIN_SAMPLES_FOR_INTERVAL:
        return Estimate(value, None, None)
    draws = statistic(
        {
            where: cell.resampled_rates_hz if of_rates else cell.resampled
            for where, cell in cells.items()
        }
    )
    low, high = np.percentile(draws, [2.5, 97.5])
    return Estimate(value, float(low), float(high))
