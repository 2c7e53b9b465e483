"""How far off pose tracking starts, and at which distance it is judged.

The paper starts 20 cm off on every control pose, from where tracking does not converge; so the
distance is a variant of the task, and a study runs several.
"""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from tasks.registry import TASKS
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores

TRACKING = Series("tracking", "photometric_tracking", "position_error_mm")
REQUIRED_SUCCESS = 0.8
"""Claims are judged at the largest perturbation that succeeds at least this often."""


def sigma_mm(variant: str) -> float | None:
    """Standard deviation of a perturbation, mm, from a variant as "sigma 2 mm"; None for others."""
    found = re.fullmatch(r"sigma ([0-9.]+) mm", variant)
    return float(found[1]) if found else None


def sweep(scores: Scores, method: str) -> list[Series]:
    """A tracking method's series by ascending perturbation."""
    found = [
        (sigma, one)
        for one in scores.series()
        if one[:3] == ("tracking", method, TRACKING.metric)
        and (sigma := sigma_mm(one.variant)) is not None
    ]
    return [one for _, one in sorted(found)]


def ideal_success(scores: Scores, series: Series) -> float | None:
    """Share of trials that succeed in ideal light at base speed, over all scenes, median of widths.

    All widths are compared at one perturbation, so one number must do for them. It is the median
    and not all trials together, since the coarsest sensors may be too coarse to succeed from
    anywhere (the paper's 128 px is erratic too), which says nothing about the others: from a
    perturbation with 80 % most widths converge. None where there are no trials.
    """
    failed: dict[int, list[NDArray[np.bool_]]] = {}
    for where in scores.conditions(series):
        if math.isinf(where.cutoff_hz) and where.speed == 1.0:
            failed.setdefault(where.width, []).append(scores.cell(series, where).failed)
    shares = [1 - np.concatenate(cells).mean() for cells in failed.values()]
    return float(np.median(shares)) if shares else None


def judged_series(scores: Scores, method: str = TRACKING.method) -> Series | None:
    """A tracking method at the perturbation at which claims are judged, None where there is none.

    That is the largest from which `TRACKING` succeeds at least `REQUIRED_SUCCESS` of the time; a
    method that was not run from there has none.
    """
    enough = [
        one
        for one in sweep(scores, TRACKING.method)
        if (success := ideal_success(scores, one)) is not None and success >= REQUIRED_SUCCESS
    ]
    if not enough:
        return None
    judged = enough[-1]._replace(method=method)
    return judged if judged in scores.series() else None


def shown_series(scores: Scores) -> list[Series]:
    """The series of a run by task, the paper's methods before our changes to them.

    Tracking is shown from the judged perturbation only; a method that was not run from there, or a
    run where none qualifies, from the smallest.
    """
    order = list(TASKS)
    judged = judged_series(scores)
    kept = []
    for one in scores.series():
        if one.task == "tracking" and sigma_mm(one.variant) is not None:
            variants = [other.variant for other in sweep(scores, one.method)]
            usual = judged.variant if judged and judged.variant in variants else variants[0]
            if one.variant != usual:
                continue
        kept.append(one)
    return sorted(kept, key=lambda one: (order.index(one.task), not is_main(one)))


def is_main(series: Series) -> bool:
    """Whether a shown series is a method as the paper has it, or a user's own."""
    usual = series._replace(variant="") if sigma_mm(series.variant) is not None else series
    return usual.of_paper
