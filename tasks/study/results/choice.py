"""Which resolution to choose under a condition, from the scores of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tasks.study.results.bandwidth import capacities_hz
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL, estimate
from tasks.study.results.metrics import METRICS, Metric, Series
from tasks.study.results.scores import Cell, Condition, Scores


@dataclass(frozen=True, slots=True)
class Pick:
    """What the rule says of some widths: all of a run, those that a bus carries, the paper's.

    Attributes
    ----------
    best
        Width with the best median, px.
    enough
        Smallest width whose median is within the metric's negligible difference of the best, px;
        one that beats doing nothing, if `worthwhile`.
    worthwhile
        Whether `best` beats doing nothing by more than is negligible. If not, there is nothing to
        recommend.
    """

    best: int
    enough: int
    worthwhile: bool


@dataclass(frozen=True, slots=True)
class OnBus:
    """What is enough on a bus.

    Attributes
    ----------
    capacity_hz
        The most events a second that it carries; the same is enough on a faster one, up to the
        capacity of the next of these.
    enough
        Of the widths whose event rate it carries; None where it carries none that is worthwhile.
    """

    capacity_hz: float
    enough: int | None


@dataclass(frozen=True, slots=True)
class Choice:
    """The best width under one condition, and the smallest that does as well.

    Attributes
    ----------
    scene, cutoff_hz, speed
        The condition.
    scores, event_rates_hz
        Median score and median event rate by width, px.
    best, enough, worthwhile
        What the rule says of all widths, as in `Pick`.
    tied
        Smallest width that the samples do not tell apart from the best: the paired 95 % interval of
        the difference reaches zero. None where the samples are too few for an interval.
    on_buses
        What the rule says of the widths that a bus carries, each by its own event rate: for the
        slowest bus of a real camera, and for each faster one on which that is another width.
    nothing
        Median score of doing nothing at the best width, None where it was not run.
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
    worthwhile: bool
    tied: int | None
    on_buses: tuple[OnBus, ...]
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
    nothing: dict[int, float] = {}
    printed: dict[int, float] = {}
    for width in scores.widths(series):
        condition = Condition(scene, width, cutoff_hz, speed)
        if (median := scores.published(series, condition)) is not None:
            printed[width] = median
        if (idle := scores.baseline(series, condition).median) is not None:
            nothing[width] = idle
        cell = scores.cell(series, condition)
        if cell.median is None or cell.event_rate_hz is None:
            return None
        cells[width], medians[width], rates[width] = cell, cell.median, cell.event_rate_hz
    picked = pick(medians, nothing, metric)
    tied = None
    if cells[picked.best].samples >= MIN_SAMPLES_FOR_INTERVAL:
        tied = next(width for width, cell in cells.items() if _tied(cells[picked.best], cell, sign))
    return Choice(
        scene=scene,
        cutoff_hz=cutoff_hz,
        speed=speed,
        scores=medians,
        event_rates_hz=rates,
        best=picked.best,
        enough=picked.enough,
        worthwhile=picked.worthwhile,
        tied=tied,
        on_buses=_on_buses(medians, rates, nothing, metric),
        nothing=nothing.get(picked.best),
        paper=pick(printed, {}, metric).enough if len(printed) == len(medians) else None,
        metric=metric,
    )


def pick(medians: Mapping[int, float], nothing: Mapping[int, float], metric: Metric) -> Pick:
    """Apply the rule to median scores by width, beside those of doing nothing where it was scored.

    Doing nothing is scored for each width, and each is held against its own.
    """

    def gain(width: int) -> float:
        return metric.sign * (medians[width] - nothing[width]) if width in nothing else math.inf

    best = max(sorted(medians), key=lambda width: metric.sign * medians[width])
    worthwhile = gain(best) > metric.negligible
    near = [w for w in medians if abs(medians[best] - medians[w]) <= metric.negligible]
    return Pick(best, min(w for w in near if not worthwhile or gain(w) > 0), worthwhile)


def _on_buses(
    medians: Mapping[int, float],
    rates_hz: Mapping[int, float],
    nothing: Mapping[int, float],
    metric: Metric,
) -> tuple[OnBus, ...]:
    """Apply the rule to what each capacity carries; a capacity that changes nothing is left out."""
    found: list[OnBus] = []
    for capacity_hz in capacities_hz():
        carried = {w: median for w, median in medians.items() if rates_hz[w] <= capacity_hz}
        picked = pick(carried, nothing, metric) if carried else None
        enough = picked.enough if picked and picked.worthwhile else None
        if not found or enough != found[-1].enough:
            found.append(OnBus(capacity_hz, enough))
    return tuple(found)


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


def answered(choices: Choices) -> list[tuple[float, float]]:
    """The cutoff in Hz and the speed of the conditions that an answer is about.

    Every light at the lowest speed, from the most to the least, then the least light at the highest
    speed; of conditions that all scenes have. What a report, README and docs say of a run is about
    these, in this order.
    """
    conditions = [
        {(cutoff, speed) for place, cutoff, speed in choices if place == scene}
        for scene in dict.fromkeys(scene for scene, _, _ in choices)
    ]
    common = set.intersection(*conditions)
    slowest = min(speed for _, speed in common)
    lights = sorted((one for one in common if one[1] == slowest), reverse=True)
    return list(dict.fromkeys([*lights, min(common, key=lambda one: (one[0], -one[1]))]))
