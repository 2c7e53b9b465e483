"""Compute intervals of statistics of medians by a percentile bootstrap over samples and trainings.

Everything is paired: differences of two cells are taken at each sample and item, before the median,
and all cells of a scene are resampled with the same indices of samples and of trainings. With
several seeds of a scene, these are resampled first, and samples within them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from tasks.metric import LAST_BITS, MIN_SAMPLES_FOR_INTERVAL, number_text
from tasks.study.results.cells import Cell, effective_samples

TAILS = (0.025, 0.025)
"""Shares of the bootstrap draws below and above a 95 % interval."""

BRACKETS = (
    "Brackets are 95 % bootstrap intervals over samples, taken as independent. Samples of one path "
    "are not: n is how many independent ones they are worth, by the correlation of neighbors, r. "
    "Where a scene has several seeds, intervals are over these, and over the samples of each; ± is "
    "the standard deviation between seeds."
)
"""What `Interval.text` prints, in words."""

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Interval:
    """A statistic of medians with its 95 % interval; no bounds if the samples are too few.

    `samples` counts the samples without equal ones. `effective_samples` is how many independent
    samples they are worth; the interval itself takes all of them as independent. `spread` is the
    standard deviation over a scene's seeds; None for a single seed.
    """

    value: float
    low: float | None
    high: float | None
    effective_samples: float | None = None
    samples: float = 0.0
    spread: float | None = None

    def includes(self, bound: float) -> bool:
        """Whether a number is within the interval, if there is one."""
        return self.low is not None and self.high is not None and self.low <= bound <= self.high

    def settles(self, bound: float) -> bool:
        """Whether there is an interval, and all of it is on the value's side of a bound."""
        if self.low is None or self.high is None:
            return False
        return min(self.low, self.value) > bound or max(self.high, self.value) < bound

    def text(self, decimals: int = 2, sign: str = "+", unit: str = "") -> str:
        """Format as ``+3.18 [+2.90, +3.40; n 12, r 0.25] dB``: `BRACKETS` says what is what."""
        unit = f" {unit}" if unit else ""
        if self.low is None or self.high is None:
            return f"{number_text(self.value, decimals, sign)}{unit}"
        value = number_text(self.value, decimals, sign, keeps_minus=self.high < 0)
        low, high = (
            number_text(bound, decimals, sign, keeps_minus=True) for bound in (self.low, self.high)
        )
        worth = ""
        if (n := self.effective_samples) is not None:
            r = f"{(self.samples - n) / (self.samples + n):.2f}"
            worth = f"; n {n:.2g}" + f", r {r}" * (float(r) > 0)
        if self.spread is not None:
            worth += f", seeds ±{number_text(self.spread, decimals, '')}"
        return f"{value} [{low}, {high}{worth}]{unit}"


Values = Mapping[Key, NDArray[np.float64]]
"""Values of cells, each (N,), in the order of their samples and items."""


@dataclass(frozen=True, slots=True)
class Medians(Generic[Key]):
    """Medians of cells, and of quantities computed from their values one by one.

    There is one for each of `parts`, consecutive parts of so many samples, (len(parts),), or for
    each bootstrap draw, (draws,), if there are none.
    """

    cells: Mapping[Key, Cell]
    sign: float = 1.0
    parts: Sequence[int] = ()

    def __getitem__(self, key: Key) -> NDArray[np.float64]:
        cell = self.cells[key]
        found = cell.medians_of(cell.values, self.parts) if self.parts else cell.resampled
        return self.sign * found

    def of(
        self, each: Callable[[Values[Key]], NDArray[np.float64]], keys: Sequence[Key]
    ) -> NDArray[np.float64]:
        """Return the medians of a function of the (N,) values of cells."""
        values = each({key: self.sign * self.cells[key].values for key in keys})
        cell = max((self.cells[key] for key in keys), key=lambda cell: cell.trainings)
        return cell.medians_of(values, self.parts)

    def difference(self, key: Key, other: Key) -> NDArray[np.float64]:
        """Return the median of the differences between the values of two cells."""
        return self.of(lambda values: values[key] - values[other], (key, other))


def estimate(
    statistic: Callable[[Medians[Key]], NDArray[np.float64]],
    *scenes: Mapping[Key, Cell],
    sign: float = 1.0,
    tails: tuple[float, float] = TAILS,
) -> Interval:
    """Evaluate a statistic of medians, with its bootstrap interval over samples and trainings.

    Each of `scenes` has complete cells with the same samples and items; the value is the mean over
    scenes. Their names seed the draws, so order has no effect. The interval is as much wider than
    the draws as Student's t says for so few samples, paths or trainings; there is none with fewer
    than `MIN_SAMPLES_FOR_INTERVAL` samples. Numbers that differ from 0 by rounding are 0. The
    effective samples are computed from the statistic of each sample alone, and add up over scenes.
    """

    def of(cells: Mapping[Key, Cell], parts: Sequence[int] = ()) -> NDArray[np.float64]:
        return statistic(Medians(cells, sign, parts))

    def mean(each: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
        mean_of_all = np.mean(each, axis=0)
        return np.where(np.abs(mean_of_all) < LAST_BITS, 0.0, mean_of_all)

    first_cells = [(cells, next(iter(cells.values()))) for cells in scenes]
    value = mean([of(cells, [first.samples]) for cells, first in first_cells]).item()
    every = [cell for cells in scenes for cell in cells.values()]
    number = min(cell.samples for cell in every)
    if number < MIN_SAMPLES_FOR_INTERVAL:
        return Interval(value, None, None)
    ends = np.quantile(mean([of(cells) for cells in scenes]), [tails[0], 1 - tails[1]])
    groups = max(cell.trainings for cell in every), min(len(cell.paths) for cell in every)
    number = min([number, *(group for group in groups if group > 1)])
    low, high = value + (ends - value) * [widening(number, tail) for tail in tails]
    worth = samples = 0.0
    for cells, first in first_cells:
        n = effective_samples(of(cells, [1] * first.samples), first.paths)
        worth, samples = worth + n, samples + (first.samples if n > 1 else n)
    one_scene = len(scenes) == 1 and len(first.paths) > 1
    spread = float(np.std(of(cells, first.paths), ddof=1)) if one_scene else None
    return Interval(value, float(low), float(high), worth, samples, spread)


def lead_over(cell: Cell, other: Cell, sign: float) -> Interval:
    """Return the median paired difference of two complete cells; positive if the first leads."""
    cells = {"cell": cell, "other": other}
    return estimate(lambda medians: medians.difference("cell", "other"), cells, sign=sign)


@lru_cache
def widening(number: int, tail: float) -> float:
    """Return how much wider an interval is than its draws of samples, paths or trainings.

    Draws of N values spread by sqrt((N - 1) / N) of the error of their mean, which besides is
    estimated from N values: the quantile is of Student's t, not of a normal distribution.
    """
    if tail == 0.0:
        return 1.0
    quantiles = stdtrit(number - 1, 1.0 - tail) / ndtri(1.0 - tail)
    return float(quantiles * math.sqrt(number / (number - 1)))
