"""Compare photoreceptors by the lead of the finest sensor and by the choice of a sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from tasks.registry import TASKS
from tasks.study.results.asked import Condition, SensorId, Series
from tasks.study.results.choice import Choice, choose
from tasks.study.results.intervals import Interval, lead_over
from tasks.study.results.scores import Scores


@dataclass(frozen=True, slots=True)
class Lead:
    """How much better the finest sensor is than the finest of a smaller width, with each
    photoreceptor.

    Attributes
    ----------
    paper
        The paper's lead; None if it lacks one of the two.
    """

    scene: str
    cutoff_hz: float
    speed: float
    sensors: tuple[SensorId, SensorId]
    found: Mapping[str, Interval | None]
    choices: Mapping[str, Choice | None]
    paper: float | None


def leads(readings: Mapping[str, Scores], series: Series) -> list[Lead]:
    """Return the leads of a series in every light but the ideal, where photoreceptors are equal;
    with v2e's program, whose times are its own, in that too."""
    first = next(iter(readings.values()))
    sensors = first.sensors(series)
    coarser = [sensor for sensor in sensors if sensor.width < sensors[-1].width]
    if not coarser:
        return []
    pair = sensors[-1], coarser[-1]
    sign = TASKS[series.task].metric.sign
    conditions = dict.fromkeys(at[:1] + at[2:4] for at in first.conditions(series))
    programs = any(name.startswith("v2e-") for name in readings)
    every = []
    for scene, cutoff_hz, speed in conditions:
        if math.isinf(cutoff_hz) and not programs:
            continue
        places = [Condition(scene, s.width, cutoff_hz, speed, s.name) for s in pair]
        intervals: dict[str, Interval | None] = {}
        for name, scores in readings.items():
            ours = [scores.cell(series, at) for at in places]
            complete = all(cell.complete for cell in ours)
            intervals[name] = lead_over(ours[0], ours[1], sign) if complete else None
        choices = {n: choose(s, series, scene, cutoff_hz, speed) for n, s in readings.items()}
        fine, coarse = (first.published(series, at) for at in places)
        paper = None if fine is None or coarse is None else sign * (fine - coarse)
        every.append(Lead(scene, cutoff_hz, speed, pair, intervals, choices, paper))
    return every
