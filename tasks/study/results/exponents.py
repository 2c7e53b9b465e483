"""Designs that differ in the exponent of the area in a cutoff: does the choice hang on it?"""

from __future__ import annotations

from collections.abc import Iterable

from tasks.study.results.asked import SensorId
from tasks.study.results.choice import Choice, choose_all
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores
from tasks.study.results.words import BaseSpeeds, cutoff_label, join_words, speed_label
from tasks.study.settings import AREA

_MOST_TOLD = 6  # conditions in which the choices differ


def designs_of(sensors: Iterable[SensorId]) -> dict[str, list[SensorId]]:
    """Return for each design, such as "area^0.5", the sensors of the others; a sensor without an
    exponent in its name is in all. Empty if there are fewer than two."""
    design = {sensor: sensor.name.partition(f" {AREA}")[2] for sensor in sensors}
    names = sorted({*design.values()} - {""})
    if len(names) < 2:
        return {}
    return {
        AREA + name: [sensor for sensor, own in design.items() if own not in ("", name)]
        for name in names
    }


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
            place = f"{scene}, {cutoff_label(cutoff_hz)}, {speed_label(scene, speed, base)}"
            text += f"; {place}: {join_words(chosen)}"
        lines.append(f"{text}.")
    return lines


def _name(choice: Choice | None) -> str:
    """Return the chosen sensor without its design."""
    return "none" if choice is None or not choice.worthwhile else width_in_design(choice.enough)
