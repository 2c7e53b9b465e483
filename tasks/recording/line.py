"""The line of light against numbers of events, whose slopes are the contrast thresholds.

See `tasks.recording.levels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tasks.errors import TaskError
from tasks.recording.levels import Levels

_PASSES = 6
_HUBER = 1.345  # standard deviations
_DELAYS = 21  # tried before the search


def best_delay_us(levels: Levels) -> float:
    """Return how late the events are: the delay at which thresholds explain the light best.

    Returns
    -------
    Within a twentieth of the time of the light, microseconds; negative if frames are late.
    """
    reach_us = levels.longest_delay_us
    tried_us = np.linspace(-reach_us, reach_us, _DELAYS)

    def unexplained(delay_us: float) -> float:
        return fit_line(levels, delay_us).unexplained

    left = list(map(unexplained, tried_us.tolist()))
    best, step_us = float(tried_us[int(np.argmin(left))]), float(tried_us[1] - tried_us[0])
    bounds = max(-reach_us, best - step_us), min(reach_us, best + step_us)
    how = {"method": "bounded", "options": {"xatol": 1.0}}
    return float(optimize.minimize_scalar(unexplained, bounds=bounds, **how).x)


class Line(NamedTuple):
    """Thresholds by robust least squares, log units."""

    on: float
    off: float
    unexplained: float
    sums: NDArray[np.float64]  # (tiles, 6) of the normal equations


def fit_line(levels: Levels, delay_us: float = 0.0, pole_s: float = 0.0, poles: int = 2) -> Line:
    """Fit both thresholds by robust regression of the light on the numbers of events.

    Each block of events of a pixel has an unknown level; subtracting the block's mean removes it.
    Huber's weights bound the effect of outliers.
    """
    y = levels.within_blocks(levels.light_at_events(delay_us, pole_s, poles))
    a, b = levels.within_blocks(levels.on), -levels.within_blocks(levels.off)
    products = np.stack([a * a, a * b, b * b, a * y, b * y, y * y])
    weight = np.ones(len(y))
    for _ in range(_PASSES):
        C_on, C_off = solved((products * weight).sum(axis=1))
        if not np.isfinite(C_on):
            break
        left = np.abs(y - C_on * a - C_off * b)
        scale = max(1.4826 * float(np.median(left)), 1e-12)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(left, 1e-12))
    of_units = [np.bincount(levels.unit, product) for product in weight * products]
    sums = np.stack(of_units, axis=1).astype(np.float64)
    total = sums.sum(axis=0)
    C_on, C_off = solved(total)
    unexplained = 1 - float(C_on * total[3] + C_off * total[4]) / max(float(total[5]), 1e-300)
    return Line(float(C_on), float(C_off), unexplained, sums)


def solved(total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve the normal equations of `fit_line`.

    Parameters
    ----------
    total
        (6,) sums over all tiles.

    Returns
    -------
    (2,) thresholds of ON and OFF; NaN if the equations are singular.
    """
    aa, ab, bb, ay, by = total[:5]
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return np.full(2, np.nan)
    return np.array([bb * ay - ab * by, aa * by - ab * ay]) / determinant


def misfit() -> TaskError:
    """Return the error of events from which no thresholds follow."""
    return TaskError(
        "thresholds: the change of the light does not match the events; frames and events must "
        "share one clock, and the light must rise and fall"
    )
