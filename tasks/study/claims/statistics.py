"""Numbers that several claims are about, of our medians and of the paper's alike."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping

import numpy as np

from tasks.study.claims.verdict import Medians, Statistic
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.paper import BASE_SPEED_M_PER_S, CUTOFFS_HZ, SPEEDS, WIDTHS, published
from tasks.study.results.scores import Cell, Condition

FAST = 10.0
"""Factor of the paper's 9 m/s on carpet."""


def paper_medians(series: Series, scene: str) -> dict[Condition, np.ndarray]:
    """Every cell that the paper's tables have for a method on a scene."""
    medians = {}
    for width, cutoff, speed in itertools.product(WIDTHS, CUTOFFS_HZ, (*SPEEDS, FAST)):
        value = published(scene, *series[:2], width, cutoff, speed, series.metric)
        if value is not None:
            medians[Condition(scene, width, cutoff, speed)] = np.array(value)
    return medians


def paper_text(
    series: Series,
    one: Callable[[str, Medians], str],
    scenes: Iterable[str] = tuple(BASE_SPEED_M_PER_S),
) -> str:
    """A line for each scene, made of the paper's medians there."""
    return "\n".join(f"{scene}: {one(scene, paper_medians(series, scene))}" for scene in scenes)


def medians_of(cells: Mapping[Condition, Cell]) -> dict[Condition, np.ndarray]:
    """Medians of complete cells."""
    return {where: np.array(cell.median) for where, cell in cells.items()}


def best_width(
    series: Series, medians: Medians, scene: str, cutoff_hz: float, speed: float = 1.0
) -> int:
    """The width with the best median, px."""
    sign = METRICS[series.metric].sign
    return max(
        WIDTHS, key=lambda width: sign * float(medians[Condition(scene, width, cutoff_hz, speed)])
    )


def lead(series: Series, scene: str, width: int, cutoff_hz: float, speed: float = 1.0) -> Statistic:
    """How much better one width is than the best of the others; positive if it is the best."""
    sign = METRICS[series.metric].sign

    def statistic(medians: Medians) -> np.ndarray:
        at = {w: sign * medians[Condition(scene, w, cutoff_hz, speed)] for w in WIDTHS}
        return at[width] - np.max([at[w] for w in WIDTHS if w != width], axis=0)

    return statistic


def grid(
    cutoffs_hz: Iterable[float], speeds: Iterable[float] = (1.0,), widths: Iterable[int] = WIDTHS
) -> list[tuple[int, float, float]]:
    """The (width, cutoff, speed) of all of these."""
    return list(itertools.product(widths, cutoffs_hz, speeds))
