"""Statistics of medians. The same statistic gives our number and the paper's.

Medians have a sign that makes larger values better: errors are negative.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tasks.study.results.intervals import Medians, Values
from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS

IDEAL, DAY, NIGHT = CUTOFFS_HZ


class SceneCell(NamedTuple):
    """A cell of one scene."""

    width: int  # px
    cutoff_hz: float
    speed: float = 1.0  # factor on the base speed
    method: str = ""  # "" for the claim's
    task: str = ""  # task of the method; "" for the claim's


PerValue = Callable[[Values[SceneCell]], NDArray[np.float64]]


class Extreme(Enum):
    """Which of its parts a statistic is."""

    SMALLEST = "smallest"
    LARGEST = "largest"


@dataclass(frozen=True, slots=True)
class Statistic:
    """A number made of medians.

    Differences are paired: where both sides are medians of one method's values, the difference is
    the median of the differences at each sample and item. All other operations combine medians.

    Attributes
    ----------
    cells
        The cells that the medians come from.
    of
        Function from the medians to an array of their shape.
    each
        For the median of a quantity per value: the function from the values of the cells to that
        quantity, (N,).
    positive
        Whether all values must be positive, because of a division or a logarithm.
    of_rates
        Whether the medians are of event rates, not of scores.
    parts, extreme
        For the smallest or the largest of several statistics: these, and which of the two. The
        interval follows from theirs.
    """

    cells: tuple[SceneCell, ...]
    of: Callable[[Medians[SceneCell]], NDArray[np.float64]]
    each: PerValue | None = None
    positive: bool = False
    of_rates: bool = False
    parts: tuple[Statistic, ...] = ()
    extreme: Extreme | None = None

    def __sub__(self, other: Statistic) -> Statistic:
        mine, theirs = self.each, other.each
        cells = tuple(dict.fromkeys((*self.cells, *other.cells)))
        of_one_kind = len({cell.method for cell in cells}) == 1 and self.of_rates == other.of_rates
        if mine is None or theirs is None or not of_one_kind:
            return _combined(np.subtract, self, other)
        return _per_value(cells, lambda at: mine(at) - theirs(at), self.of_rates)

    def __truediv__(self, other: Statistic) -> Statistic:
        return _combined(np.divide, self, other, positive=True)


def _per_value(cells: tuple[SceneCell, ...], each: PerValue, of_rates: bool = False) -> Statistic:
    return Statistic(cells, lambda medians: medians.of(each, cells), each, of_rates=of_rates)


def _combined(
    function: Callable[..., NDArray[np.float64]], *parts: Statistic, positive: bool = False
) -> Statistic:
    return Statistic(
        tuple(dict.fromkeys(cell for part in parts for cell in part.cells)),
        lambda medians: function(*(part.of(medians) for part in parts)),
        positive=positive or any(part.positive for part in parts),
        of_rates=any(part.of_rates for part in parts),
    )


def median(
    width: int, cutoff_hz: float, speed: float = 1.0, method: str = "", task: str = ""
) -> Statistic:
    """Return the median score of one cell.

    Parameters
    ----------
    width
        Sensor width, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.
    speed
        Factor on the base speed.
    method
        Name of the method; "" for the claim's.
    task
        Task of the method; "" for the claim's.

    Returns
    -------
    Statistic
        In the metric's unit; errors are negative.
    """
    cell = SceneCell(width, cutoff_hz, speed, method, task)
    return Statistic((cell,), lambda medians: medians[cell], lambda at: at[cell])


def event_rate(width: int, cutoff_hz: float) -> Statistic:
    """Return the median event rate of the whole sensor at base speed.

    Parameters
    ----------
    width
        Sensor width, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.

    Returns
    -------
    Statistic
        Events per second.
    """
    return replace(median(width, cutoff_hz), of_rates=True)


def pixel_rate(width: int, cutoff_hz: float) -> Statistic:
    """Return the median event rate of one pixel at base speed.

    Parameters
    ----------
    width
        Sensor width, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.

    Returns
    -------
    Statistic
        Events per second and pixel.
    """
    cell = SceneCell(width, cutoff_hz)
    return _per_value((cell,), lambda rates: rates[cell] / width**2, of_rates=True)


def margin(width: int, other: int, cutoff_hz: float, speed: float = 1.0) -> Statistic:
    """Return how much better one width is than another.

    Parameters
    ----------
    width, other
        Sensor widths, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.
    speed
        Factor on the base speed.

    Returns
    -------
    Statistic
        In the metric's unit; positive if `width` is better.
    """
    return median(width, cutoff_hz, speed) - median(other, cutoff_hz, speed)


def lead(
    widths: Sequence[int], cutoff_hz: float, speed: float = 1.0, method: str = ""
) -> Statistic:
    """Return how much better the best of some widths is than the best of all others.

    Parameters
    ----------
    widths
        Some of the paper's sensor widths, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.
    speed
        Factor on the base speed.
    method
        Name of the method; "" for the claim's.

    Returns
    -------
    Statistic
        In the metric's unit; positive if one of `widths` is better than each other width.
    """
    first = [median(width, cutoff_hz, speed, method) for width in widths]
    rest = [median(width, cutoff_hz, speed, method) for width in WIDTHS if width not in widths]
    return largest(*(smallest(*(width - other for other in rest)) for width in first))


def growth(width: int, method: str = "", task: str = "") -> Statistic:
    """Return the error at night over that in ideal light, at base speed.

    Parameters
    ----------
    width
        Sensor width, px.
    method
        Name of the method; "" for the claim's.
    task
        Task of the method; "" for the claim's.

    Returns
    -------
    Statistic
        A factor.
    """
    night, ideal = (median(width, c, method=method, task=task) for c in (NIGHT, IDEAL))
    return night / ideal


def smallest(*statistics: Statistic) -> Statistic:
    """Return the smallest of several statistics."""
    combined = _combined(lambda *values: np.min(values, axis=0), *statistics)
    return replace(combined, extreme=Extreme.SMALLEST, parts=statistics)


def largest(*statistics: Statistic) -> Statistic:
    """Return the largest of several statistics."""
    combined = _combined(lambda *values: np.max(values, axis=0), *statistics)
    return replace(combined, extreme=Extreme.LARGEST, parts=statistics)


def smallest_fall(*statistics: Statistic) -> Statistic:
    """Return the smallest fall from one statistic to the next."""
    return smallest(*(before - after for before, after in pairwise(statistics)))


def spread(*statistics: Statistic) -> Statistic:
    """Return the largest difference between two of several statistics."""
    return largest(*(first - second for first, second in permutations(statistics, 2)))


def log2(statistic: Statistic) -> Statistic:
    """Return the logarithm to base 2."""
    return _combined(np.log2, statistic, positive=True)


def slope(of_widths: Sequence[Statistic]) -> Statistic:
    """Return the rise per doubling of the width, from a least-squares line through `WIDTHS`."""
    doublings = np.log2(WIDTHS)
    weights = (doublings - doublings.mean()) / np.sum((doublings - doublings.mean()) ** 2)
    return _combined(lambda *values: np.tensordot(weights, np.array(values), axes=1), *of_widths)
