"""Choose a sensor for a condition, from the scores of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tasks.metric import MIN_SAMPLES_FOR_INTERVAL, Metric
from tasks.registry import TASKS
from tasks.study.results.asked import MetersPerSecond, SensorId
from tasks.study.results.bandwidth import capacities_hz
from tasks.study.results.cells import Cell, Condition
from tasks.study.results.intervals import estimate
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores


@dataclass(frozen=True, slots=True)
class Pick:
    """Result of the rule for a set of sensors.

    Attributes
    ----------
    enough
        Sensor of the smallest width with a median within the negligible difference of the best; of
        several, the one with the best median. If `worthwhile`, it also beats doing nothing.
    worthwhile
        Whether `best` beats doing nothing by more than the negligible difference. If not, no sensor
        is recommended.
    """

    best: SensorId
    enough: SensorId
    worthwhile: bool
    gaining: frozenset[SensorId]


@dataclass(frozen=True, slots=True)
class Choice:
    """Best sensor under one condition, and the smallest that is as good.

    Attributes
    ----------
    tied
        Sensor of the smallest width, smaller than that of `enough`, that beats doing nothing and
        that the samples do not separate from the best: the paired 95 % interval of the difference
        contains zero. None if there is none, or the samples are too few for an interval.
    on_buses
        `enough` of the sensors that a bus carries, by the capacity of each bus of real cameras in
        events/s; None if none of them is worthwhile.
    paper
        `enough` from the paper's medians; None if the paper lacks one of the sensors.
    """

    event_rates_hz: Mapping[SensorId, float]
    best: SensorId
    enough: SensorId
    worthwhile: bool
    tied: SensorId | None
    on_buses: Mapping[float, SensorId | None]
    paper: SensorId | None


Choices = dict[tuple[str, float, float], Choice | None]
"""Choices by scene, cutoff in Hz and speed; None if a sensor lacks samples."""


def choose(
    scores: Scores,
    series: Series,
    scene: str,
    cutoff_hz: float,
    speed: float,
    among: Callable[[SensorId], bool] = bool,
) -> Choice | None:
    """Choose a sensor for one condition.

    Parameters
    ----------
    cutoff_hz
        Photoreceptor cutoff, Hz.
    """
    metric = TASKS[series.task].metric
    sign = metric.sign
    cells = {}
    medians: dict[SensorId, float] = {}
    rates: dict[SensorId, float] = {}
    nothing: dict[SensorId, float] = {}
    printed: dict[SensorId, float] = {}
    for sensor in filter(among, scores.sensors(series, scene)):
        condition = Condition(scene, sensor.width, cutoff_hz, speed, sensor.name)
        if (median := scores.published(series, condition)) is not None:
            printed[sensor] = median
        if (idle := scores.baseline(series, condition).median) is not None:
            nothing[sensor] = idle
        cell = scores.cell(series, condition)
        if cell.median is None or cell.event_rate_hz is None:
            return None
        cells[sensor], medians[sensor], rates[sensor] = cell, cell.median, cell.event_rate_hz
    picked = pick(medians, nothing, metric)
    on_buses: dict[float, SensorId | None] = {}
    for capacity_hz in capacities_hz():
        carried = {one: median for one, median in medians.items() if rates[one] <= capacity_hz}
        found = pick(carried, nothing, metric) if carried else None
        on_buses[capacity_hz] = found.enough if found and found.worthwhile else None
    best = cells[picked.best]
    smaller = [one for one in cells if one.width < picked.enough.width and one in picked.gaining]
    if best.samples < MIN_SAMPLES_FOR_INTERVAL:
        smaller = []
    return Choice(
        event_rates_hz=rates,
        best=picked.best,
        enough=picked.enough,
        worthwhile=picked.worthwhile,
        tied=next((one for one in smaller if _tied(best, cells[one], sign)), None),
        on_buses=on_buses,
        paper=pick(printed, {}, metric).enough if len(printed) == len(medians) else None,
    )


def pick(
    medians: Mapping[SensorId, float], nothing: Mapping[SensorId, float], metric: Metric
) -> Pick:
    """Apply the rule to median scores."""

    def gain(one: SensorId) -> float:
        return metric.sign * (medians[one] - nothing[one]) if one in nothing else math.inf

    best = max(sorted(medians), key=lambda one: metric.sign * medians[one])
    worthwhile = gain(best) > metric.negligible
    near = [one for one in medians if abs(medians[best] - medians[one]) <= metric.negligible]
    enough = min(
        (one for one in near if not worthwhile or gain(one) > 0),
        key=lambda one: (one.width, -metric.sign * medians[one], one.name),
    )
    return Pick(best, enough, worthwhile, frozenset(one for one in medians if gain(one) > 0))


def _tied(best: Cell, other: Cell, sign: float) -> bool:
    """Return whether the interval of the paired difference is not above zero."""
    cells = {"best": best, "other": other}
    lead = estimate(lambda medians: medians.difference("best", "other"), cells, sign=sign)
    return lead.low is None or lead.low <= 0


def choose_all(scores: Scores, series: Series, among: Callable[[SensorId], bool] = bool) -> Choices:
    """Choose a sensor for every condition of a series."""
    return {
        (scene, cutoff, speed): choose(scores, series, scene, cutoff, speed, among)
        for scene in scores.scenes(series)
        for cutoff in scores.cutoffs_hz(series)
        for speed in scores.speeds(series, scene)
    }


def answered(choices: Choices) -> list[tuple[float, float]]:
    """Return (cutoff in Hz, speed) of the conditions that an answer names, in order.

    They are every light at the lowest speed, from most to least light, and the least light at the
    highest speed. Only conditions that all scenes have count, or all if there are none.
    """
    conditions = [
        {(cutoff, speed) for place, cutoff, speed in choices if place == scene}
        for scene in dict.fromkeys(scene for scene, _, _ in choices)
    ]
    common = set.intersection(*conditions) or set.union(*conditions)
    # A study in m/s may have flow at a factor as well, which is faster.
    common = {one for one in common if isinstance(one[1], MetersPerSecond)} or common
    slowest = min(speed for _, speed in common)
    lights = sorted((one for one in common if one[1] == slowest), reverse=True)
    return list(dict.fromkeys([*lights, min(common, key=lambda one: (one[0], -one[1]))]))
