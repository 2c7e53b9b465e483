"""Compare photoreceptors by the lead of the finest sensor and by the choice of a sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tasks.registry import TASKS
from tasks.study.results.asked import SensorId
from tasks.study.results.cells import Condition
from tasks.study.results.choice import Choice, choose
from tasks.study.results.intervals import Interval, estimate
from tasks.study.results.metrics import Series
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
    """Return the leads of a series in every light but the ideal, where photoreceptors are equal."""
    first = next(iter(readings.values()))
    sensors = first.sensors(series)
    coarser = [one for one in sensors if one.width < sensors[-1].width]
    if not coarser:
        return []
    fine, coarse = sensors[-1], coarser[-1]
    sign = TASKS[series.task].metric.sign
    found = []
    for scene, cutoff_hz, speed in dict.fromkeys(
        (at.scene, at.cutoff_hz, at.speed) for at in first.conditions(series)
    ):
        if math.isinf(cutoff_hz):
            continue
        places = {
            one: Condition(scene, one.width, cutoff_hz, speed, one.name) for one in (fine, coarse)
        }
        paper = [first.published(series, where) for where in places.values()]
        found.append(
            Lead(
                *(scene, cutoff_hz, speed, (fine, coarse)),
                {name: _lead(one, series, places, sign) for name, one in readings.items()},
                {
                    name: choose(one, series, scene, cutoff_hz, speed)
                    for name, one in readings.items()
                },
                _difference(paper, sign),
            )
        )
    return found


def _lead(
    scores: Scores, series: Series, places: Mapping[SensorId, Condition], sign: float
) -> Interval | None:
    cells = {one: scores.cell(series, where) for one, where in places.items()}
    if not all(cell.complete for cell in cells.values()):
        return None
    return estimate(lambda medians: medians.difference(*places), cells, sign=sign)


def _difference(values: Sequence[float | None], sign: float) -> float | None:
    one, other = values
    return None if one is None or other is None else sign * (one - other)
