"""Statistics of medians. The same statistic gives our number and the paper's.

A statistic takes medians with a sign that makes more of them better: errors are negative.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tasks.study.results.paper import CUTOFFS_HZ, WIDTHS

IDEAL, DAY, NIGHT = CUTOFFS_HZ


class SceneCell(NamedTuple):
    """A cell of one scene."""

    width: int  # px
    cutoff_hz: float
    speed: float = 1.0  # factor on the base speed
    method: str = ""  # "" is the method that the claim is about


Medians = Mapping[SceneCell, np.ndarray]  # each () from the samples, or (draws,) from resamples


@dataclass(frozen=True, slots=True)
class Statistic:
    """A number made of medians.

    Attributes
    ----------
    cells
        The cells that the medians come from.
    of
        Function from the medians, arrays of one shape, to an array of that shape.
    positive
        Whether no median may be 0, because of a division or a logarithm.
    of_rates
        Whether the medians are those of event rates, not of scores.
    """

    cells: tuple[SceneCell, ...]
    of: Callable[[Medians], np.ndarray]
    positive: bool = False
    of_rates: bool = False

    def __sub__(self, other: Statistic) -> Statistic:
        return _combined(np.subtract, self, other)

    def __truediv__(self, other: Statistic) -> Statistic:
        return _combined(np.divide, self, other, positive=True)


def _combined(
    function: Callable[..., np.ndarray], *parts: Statistic, positive: bool = False
) -> Statistic:
    return Statistic(
        tuple(dict.fromkeys(cell for part in parts for cell in part.cells)),
        lambda medians: function(*(part.of(medians) for part in parts)),
        positive or any(part.positive for part in parts),
        any(part.of_rates for part in parts),
    )


def median(width: int, cutoff_hz: float, speed: float = 1.0, method: str = "") -> Statistic:
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
        Another method than that of the claim; "" for that of the claim.

    Returns
    -------
    Statistic
        In the metric's unit; errors are negative.
    """
    cell = SceneCell(width, cutoff_hz, speed, method)
    return Statistic((cell,), lambda medians: medians[cell])


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
    cell = SceneCell(width, cutoff_hz)
    return Statistic((cell,), lambda rates: rates[cell], of_rates=True)


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
    return _combined(lambda rate: rate / width**2, event_rate(width, cutoff_hz))


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


def lead(widths: Sequence[int], cutoff_hz: float, speed: float = 1.0) -> Statistic:
    """Return how much better the best of some widths is than the best of all others.

    Parameters
    ----------
    widths
        Some of the paper's sensor widths, px.
    cutoff_hz
        Photoreceptor cutoff, Hz.
    speed
        Factor on the base speed.

    Returns
    -------
    Statistic
        In the metric's unit; positive if one of `widths` is the best.
    """
    at = {width: median(width, cutoff_hz, speed) for width in WIDTHS}
    others = [at[width] for width in WIDTHS if width not in widths]
    return largest(*(at[width] for width in widths)) - largest(*others)


def growth(width: int, method: str = "") -> Statistic:
    """Return the error at night over that in ideal light, at base speed.

    Parameters
    ----------
    width
        Sensor width, px.
    method
        Another method than that of the claim; "" for that of the claim.

    Returns
    -------
    Statistic
        A factor.
    """
    return median(width, NIGHT, method=method) / median(width, IDEAL, method=method)


def smallest(*statistics: Statistic) -> Statistic:
    """Return the smallest of several statistics."""
    return _combined(lambda *values: np.min(values, axis=0), *statistics)


def largest(*statistics: Statistic) -> Statistic:
    """Return the largest of several statistics."""
    return _combined(lambda *values: np.max(values, axis=0), *statistics)


def smallest_fall(*statistics: Statistic) -> Statistic:
    """Return the smallest fall from one statistic to the next."""
    return smallest(*(before - after for before, after in pairwise(statistics)))


def spread(*statistics: Statistic) -> Statistic:
    """Return the largest of several statistics minus the smallest."""
    return largest(*statistics) - smallest(*statistics)


def log2(statistic: Statistic) -> Statistic:
    """Return the logarithm to base 2."""
    return _combined(np.log2, statistic, positive=True)


def slope(of_widths: Sequence[Statistic]) -> Statistic:
    """Return the rise per doubling of the width, from a least-squares line through `WIDTHS`."""
    doublings = np.log2(WIDTHS)
    weights = (doublings - doublings.mean()) / np.sum((doublings - doublings.mean()) ** 2)
    return _combined(lambda *values: np.tensordot(weights, np.array(values), axes=1), *of_widths)
