"""Choose a sensor for a condition, from the scores of a run.

A study can have designs, which differ in the exponent of the area in a cutoff: names of their
sensors end with it, as in "gen4 area^0.5".
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from sensor import camera_names, find_camera
from tasks.metric import Metric
from tasks.study.results.asked import MetersPerSecond, SensorId, Series
from tasks.study.results.intervals import lead_over
from tasks.study.results.scores import Scores
from tasks.study.results.words import BaseSpeeds, join_words, setting_label
from tasks.study.settings import AREA

_MOST_TOLD = 6  # conditions in which the choices differ


@dataclass(frozen=True, slots=True)
class Pick:
    """Result of the rule for a set of sensors.

    `enough` is the sensor of the smallest width with a median within the negligible difference of
    the best; of several, the sensor with the best median. `worthwhile` says whether `best` beats
    doing nothing by more than the negligible difference, and then `enough` also beats it. If not,
    no sensor is recommended.
    """

    best: SensorId
    enough: SensorId
    worthwhile: bool
    gaining: frozenset[SensorId]  # those that beat doing nothing


@dataclass(frozen=True, slots=True)
class Choice(Pick):
    """Best sensor under one condition, and the smallest that is as good.

    `tied` is the sensor of the smallest width below `enough` that beats doing nothing and that the
    samples do not separate from the best: the paired 95 % interval of the difference contains zero.
    `on_buses` is `enough` of the sensors that a bus carries, by the capacity of each bus of real
    cameras in events/s; None if no sensor is worthwhile. `paper` is `enough` from the paper's
    medians.
    """

    event_rates_hz: Mapping[SensorId, float]
    tied: SensorId | None
    on_buses: Mapping[float, SensorId | None]
    paper: SensorId | None


Choices = dict[tuple[str, float, float], Choice | None]
"""Choices by scene, cutoff in Hz and speed; None if a sensor lacks samples."""


def capacities_hz(widest: float = math.inf) -> list[float]:
    """Return the distinct bus capacities of real cameras up to a width, events/s, ascending."""
    cameras = map(find_camera, camera_names())
    narrow = [camera for camera in cameras if camera.width is not None and camera.width <= widest]
    return sorted({camera.bus_hz for camera in narrow} - {math.inf})


def usual_bus_hz(width: int) -> float:
    """Return the capacity of the fastest bus of real cameras up to a width, events/s."""
    return max(capacities_hz(width), default=min(capacities_hz()))


def choose(
    scores: Scores,
    series: Series,
    scene: str,
    cutoff_hz: float,
    speed: float,
    without: Collection[SensorId] = (),
) -> Choice | None:
    """Choose a sensor for one condition."""
    metric = series.spec.metric
    sensors = [sensor for sensor in scores.sensors(series, scene) if sensor not in without]
    places = {s: s.at(scene, cutoff_hz, speed) for s in sensors}
    cells = {sensor: scores.cell(series, at) for sensor, at in places.items()}
    medians = {sensor: cell.median for sensor, cell in cells.items()}
    nothing = {sensor: scores.baseline(series, at).median for sensor, at in places.items()}
    picked = pick(medians, nothing, metric)
    if picked is None:
        return None
    rates = {s: hz for s, cell in cells.items() if (hz := cell.event_rate_hz) is not None}
    on_buses: dict[float, SensorId | None] = {}
    for capacity_hz in capacities_hz():
        carried = {s: median for s, median in medians.items() if rates[s] <= capacity_hz}
        on_bus = pick(carried, nothing, metric)
        on_buses[capacity_hz] = on_bus.enough if on_bus and on_bus.worthwhile else None
    best = cells[picked.best]
    smaller = [s for s in cells if s.width < picked.enough.width and s in picked.gaining]
    lows = ((s, lead_over(best, cells[s], metric.sign).low) for s in smaller)
    tied = next((s for s, low in lows if low is not None and low <= 0), None)
    published = {sensor: scores.published(series, at) for sensor, at in places.items()}
    papers = pick(published, {}, metric)
    rule = picked.best, picked.enough, picked.worthwhile, picked.gaining
    return Choice(*rule, rates, tied, on_buses, papers.enough if papers else None)


def pick(
    medians: Mapping[SensorId, float | None],
    nothing: Mapping[SensorId, float | None],
    metric: Metric,
) -> Pick | None:
    """Apply the rule to median scores; None if one is missing, or there are none."""
    sign = metric.sign
    scores = {sensor: sign * median for sensor, median in medians.items() if median is not None}
    if not scores or len(scores) < len(medians):
        return None
    idle = {sensor: sign * median for sensor, median in nothing.items() if median is not None}
    gains = {sensor: score - idle.get(sensor, -math.inf) for sensor, score in scores.items()}
    best = max(sorted(scores), key=lambda sensor: scores[sensor])
    worthwhile = gains[best] > metric.negligible
    near = [s for s, score in scores.items() if abs(scores[best] - score) <= metric.negligible]
    enough = min(
        (sensor for sensor in near if not worthwhile or gains[sensor] > 0),
        key=lambda sensor: (sensor.width, -scores[sensor], sensor.name),
    )
    return Pick(best, enough, worthwhile, frozenset(s for s, gain in gains.items() if gain > 0))


def choose_all(scores: Scores, series: Series, without: Collection[SensorId] = ()) -> Choices:
    """Choose a sensor for every condition of a series."""
    return {
        (scene, cutoff, speed): choose(scores, series, scene, cutoff, speed, without)
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
    common = {at for at in common if isinstance(at[1], MetersPerSecond)} or common
    slowest = min(speed for _, speed in common)
    lights = sorted((at for at in common if at[1] == slowest), reverse=True)
    return list(dict.fromkeys([*lights, min(common, key=lambda at: (at[0], -at[1]))]))


def designs_of(sensors: Iterable[SensorId]) -> dict[str, list[SensorId]]:
    """Return for each design, such as "area^0.5", the sensors of the others; a sensor without an
    exponent in its name is in all. Empty if there are fewer than two."""
    own = {sensor: sensor.name.partition(f" {AREA}")[2] for sensor in sensors}
    names = sorted({*own.values()} - {""})
    others = {AREA + name: [s for s, of in own.items() if of not in ("", name)] for name in names}
    return others if len(names) > 1 else {}


def width_in_design(sensor: SensorId) -> str:
    """Return the name of a sensor without its design, or its width."""
    return str(sensor).partition(f" {AREA}")[0]


def exponents_text(scores: Scores, series: Iterable[Series], base: BaseSpeeds) -> list[str]:
    """Say for each series in how many conditions the choice is the same for all designs."""
    lines = []
    for each in series:
        designs = designs_of(scores.sensors(each))
        if not designs:
            continue
        at = {name: choose_all(scores, each, others) for name, others in designs.items()}
        first = next(iter(at.values()))
        names_at = {where: [_name(chosen[where]) for chosen in at.values()] for where in first}
        differing = {where: names for where, names in names_at.items() if len({*names}) > 1}
        text = (
            f"{each.title}: with {'; '.join(designs)}, the choice is the same in "
            f"{len(names_at) - len(differing)} of {len(names_at)} conditions"
        )
        if len(differing) > _MOST_TOLD:
            lines.append(f"{text}; the report shows all.")
            continue
        for (scene, cutoff_hz, speed), names in differing.items():
            chosen = [f"{name} with {design}" for name, design in zip(names, at, strict=True)]
            place = setting_label(scene, cutoff_hz, speed, base)
            text += f"; {scene}, {place}: {join_words(chosen)}"
        lines.append(f"{text}.")
    return lines


def _name(choice: Choice | None) -> str:
    """Return the chosen sensor without its design."""
    return "none" if choice is None or not choice.worthwhile else width_in_design(choice.enough)
