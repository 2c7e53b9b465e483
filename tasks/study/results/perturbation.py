"""Select the initial perturbation of pose tracking at which claims are judged.

The paper shifts every control pose by 20 cm. Tracking does not converge from there, so the
perturbation is a variant of the task, and a study can run several.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tasks.registry import TASKS, sigma_mm
from tasks.study.results.asked import SensorId, Series, sensor_of
from tasks.study.results.scores import Scores, base_speed

TRACKING = Series("tracking", "photometric_tracking", "position_error_mm")
REQUIRED_SUCCESS = 0.8
"""Claims are judged at the largest perturbation with at least this share of successes."""


def sweep(scores: Scores, method: str) -> list[Series]:
    """Return the series of a tracking method by ascending perturbation."""
    usual = TRACKING._replace(method=method)
    every = [series for series in scores.series() if series[:3] == usual[:3]]
    sigmas = {s: sigma for s in every if (sigma := sigma_mm(s.variant)) is not None}
    return sorted(sigmas, key=sigmas.__getitem__)


def ideal_success(scores: Scores, series: Series) -> float | None:
    """Return the share of successful trials in ideal light at base speed, over all scenes.

    It is the median over sensors, as the coarsest can fail from any perturbation (the paper's 128
    px is erratic too).
    """
    failed: dict[SensorId, list[NDArray[np.bool_]]] = {}
    base = base_speed(scores, series)
    for where in scores.conditions(series):
        cell = scores.cell(series, where)
        if math.isinf(where.cutoff_hz) and where.speed == base and cell.complete:
            failed.setdefault(sensor_of(where), []).append(cell.failed)
    shares = [1 - np.concatenate(cells).mean() for cells in failed.values()]
    return float(np.median(shares)) if shares else None


def judged_series(scores: Scores) -> Series | None:
    """Return `TRACKING` at the largest perturbation from which it reaches `REQUIRED_SUCCESS`."""
    for series in reversed(sweep(scores, TRACKING.method)):
        if (ideal_success(scores, series) or 0.0) >= REQUIRED_SUCCESS:
            return series
    return None


def shown_series(scores: Scores) -> list[Series]:
    """Return the series that report and tables show, by task, main methods first.

    Tracking appears only at the judged perturbation, or at the smallest if the method lacks it.
    """
    order = list(TASKS)
    judged = judged_series(scores)
    shown = []
    for series in scores.series():
        variants = sweep(scores, series.method)
        usual = judged and judged._replace(method=series.method)
        if series not in variants or series == (usual if usual in variants else variants[0]):
            shown.append(series)
    return sorted(shown, key=lambda series: (order.index(series.task), not is_main(series)))


def is_main(series: Series) -> bool:
    """Return whether a series is a method of the paper, or a user's own."""
    usual = not series.variant or sigma_mm(series.variant) is not None
    return usual and series.is_method and not series.spec.method(series.method).ours
