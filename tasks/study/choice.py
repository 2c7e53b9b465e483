"""Which resolution to choose under a condition, from the scores of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tasks.study.bus import Load, survivors
from tasks.study.judging import MIN_SAMPLES_FOR_INTERVAL, estimate
from tasks.study.scores import METRICS, Cell, Condition, Metric, Scores, Series


@dataclass(frozen=True, slots=True)
class Choice:
    """The best width under one condition, and the smallest that does as well.

    Attributes
    ----------
    scene, cutoff_hz, speed
        The condition.
    scores, event_rates_hz
        Median score and median event rate by width, px.
    best
        Width with the best median, px.
    enough
        Smallest width whose median is within the metric's negligible difference of the best, px.
    tied
        Smallest width that the samples do not tell apart from the best: the paired 95 % interval of
        the difference reaches zero. None where the samples are too few for an interval.
    on_bus
        The real camera whose width is `enough` if only those widths count whose events its bus
        carries, and what they take of it. None where no bus carries any.
    nothing
        Median score of doing nothing, None where it was not run.
    paper
        What `enough` is by the paper's medians, None where it does not print those of all widths.
    metric
        Of the scores.
    """

    scene: str
    cutoff_hz: float
    speed: float
    scores: Mapping[int, float]
    event_rates_hz: Mapping[int, float]
    best: int
    enough: int
    tied: int | None
    on_bus: Load | None
    nothing: float | None
    paper: int | None
    metric: Metric

    @property
    def loss(self) -> float:
        """How much worse `enough` is than `best`, at least 0."""
        return abs(self.scores[self.best] - self.scores[self.enough])

    @property
    def gain(self) -> float | None:
        """How far `best` is from doing nothing, None where that was not run."""
        return None if self.nothing is None else abs(self.scores[self.best] - self.nothing)

    @property
    def worthwhile(self) -> bool:
        """Whether the best width beats doing nothing by more than is negligible."""
        if self.nothing is None:
            return True
        gain = self.metric.sign * (self.scores[self.best] - self.nothing)
        return gain > self.metric.negligible

    def saving(self, width: int) -> float | None:
        """Events at `width` for each event at `enough`, None where `enough` has no events."""
        rate = self.event_rates_hz[self.enough]
        return self.event_rates_hz[width] / rate if rate > 0 else None


Choices = dict[tuple[str, float, float], Choice | None]
"""Choices by scene, cutoff in Hz and speed; None where a width has not all samples."""


def choose(
    scores: Scores, series: Series, scene: str, cutoff_hz: float, speed: float
) -> Choice | None:
    """Choose a width for one condition, or None where a width has not all samples."""
    metric = METRICS[series.metric]
    sign = metric.sign
    cells = {}
    medians: dict[int, float] = {}
    rates: dict[int, float] = {}
    printed: dict[int, float] = {}
    for width in scores.widths(series):
        condition = Condition(scene, width, cutoff_hz, speed)
        if (median := scores.published(series, condition)) is not None:
            printed[width] = median
        cell = scores.cell(series, condition)
        if cell.median is None or cell.event_rate_hz is None:
            return None
        cells[width], medians[width], rates[width] = cell, cell.median, cell.event_rate_hz
    best, enough = _best_and_enough(medians, metric)
    carried = survivors(rates)
    on_bus = None
    if carried:
        on_bus = carried[_best_and_enough({w: medians[w] for w in carried}, metric)[1]]
    tied = None
    if cells[best].samples >= MIN_SAMPLES_FOR_INTERVAL:
        tied = next(width for width, cell in cells.items() if _tied(cells[best], cell, sign))
    return Choice(
        scene=scene,
        cutoff_hz=cutoff_hz,
        speed=speed,
        scores=medians,
        event_rates_hz=rates,
        best=best,
        enough=enough,
        tied=tied,
        on_bus=on_bus,
        nothing=scores.baseline(series, Condition(scene, best, cutoff_hz, speed)).median,
        paper=_best_and_enough(printed, metric)[1] if len(printed) == len(medians) else None,
        metric=metric,
    )


def _best_and_enough(medians: Mapping[int, float], metric: Metric) -> tuple[int, int]:
    best = max(medians, key=lambda width: metric.sign * medians[width])
    return best, min(w for w in medians if abs(medians[best] - medians[w]) <= metric.negligible)


def _tied(best: Cell, other: Cell, sign: float) -> bool:
    """Whether the interval of the paired difference of medians reaches zero."""
    cells = {"best": best, "other": other}
    lead = estimate(cells, lambda m: np.asarray(sign * (m["best"] - m["other"])))
    return lead.low is None or lead.low <= 0


def choose_all(scores: Scores, series: Series) -> Choices:
    """Choose a width for every condition of a series."""
    return {
        (scene, cutoff, speed): choose(scores, series, scene, cutoff, speed)
        for scene in scores.scenes(series)
        for cutoff in scores.cutoffs_hz(series)
        for speed in scores.speeds(series, scene)
    }
