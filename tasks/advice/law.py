"""The lag law of event integration with two equal poles; docs/what_decides.md derives it."""

from __future__ import annotations

import math
from collections.abc import Sequence

CROSSING_PX = 1.0
"""Lag at which two neighboring widths are as good, px of the finer one. It is not fitted."""

NEAR_PX = (0.7, 1.4)
"""Lags around it, px, at which the law does not decide."""


def delay_s(cutoff_hz: float, poles: int = 2) -> float:
    """Return the delay of poles of one corner frequency, 1 / (2 pi f) each.

    Parameters
    ----------
    cutoff_hz
        The corner frequency, Hz.
    poles
        Their number.

    Returns
    -------
    float
        Delay, s.
    """
    return poles / (2 * math.pi * cutoff_hz)


def lag_px(speed_px_s: float, cutoff_hz: float, poles: int = 2) -> float:
    """Return how far an image moves during the delay of the pixels that see it.

    Parameters
    ----------
    speed_px_s
        Speed of the image, px/s of the sensor.
    cutoff_hz
        Corner frequency of each of its poles, Hz; inf for pixels without delay.
    poles
        Their number.

    Returns
    -------
    float
        Lag, px of the sensor.

    Examples
    --------
    >>> from tasks.advice.law import lag_px
    >>> round(lag_px(550, 200), 3)  # the paper's carpet by day, 1280 px
    0.875
    """
    return speed_px_s * delay_s(cutoff_hz, poles)


def finer_wins(lag: float, crossing_px: float = CROSSING_PX) -> bool:
    """Return whether the finer of two neighboring widths has the better images.

    Parameters
    ----------
    lag
        Lag of the finer one, px.
    crossing_px
        Lag at which both are as good, px.

    Returns
    -------
    bool
    """
    return lag < crossing_px


def chosen(lags_px: Sequence[float]) -> int:
    """Return the index of the width to choose.

    Parameters
    ----------
    lags_px
        Lag at each width, from the coarsest to the finest, px of that width.

    Returns
    -------
    int
        The last of those that are finer than their neighbor and win, from the coarsest on.
    """
    return [*map(finer_wins, lags_px[1:]), False].index(False)
