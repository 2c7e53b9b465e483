"""Whether the choice of a sensor hangs on the exponent of the area in a cutoff that is lent."""

from __future__ import annotations

from collections.abc import Iterable

from tasks.study.results.asked import SensorId
from tasks.study.results.choice import Choice, choose_all
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores
from tasks.study.results.words import BaseSpeeds, cutoff_label, join_words, speed_label
from tasks.study.sensors import AREA


def exponents_text(scores: Scores, series: Iterable[Series], base: BaseSpeeds) -> list[str]:
    """Say for each series in how many conditions the choice is the same at all exponents."""
    lines = []
    for each in series:
        power_of = {sensor: _power(sensor) for sensor in scores.sensors(each)}
        powers = [power for power in dict.fromkeys(power_of.values()) if power]
        if len(powers) < 2:
            continue
        without = {p: [s for s, own in power_of.items() if own not in ("", p)] for p in powers}
        at = {power: choose_all(scores, each, others) for power, others in without.items()}
        names_at = {where: [_name(at[power][where]) for power in powers] for where in at[powers[0]]}
        differing = {where: names for where, names in names_at.items() if len({*names}) > 1}
        text = (
            f"{each.title}: at exponents {join_words(powers)} of the photodiode's area, the choice "
            f"is the same in {len(names_at) - len(differing)} of {len(names_at)} conditions"
        )
        for (scene, cutoff_hz, speed), names in differing.items():
            chosen = [f"{name} at {power}" for name, power in zip(names, powers, strict=True)]
            place = f"{scene}, {cutoff_label(cutoff_hz)}, {speed_label(scene, speed, base)}"
            text += f"; {place}: {join_words(chosen)}"
        lines.append(f"{text}.")
    return lines


def _power(sensor: SensorId) -> str:
    """Return the exponent in the name of a sensor; "" if it has none."""
    return sensor.name.partition(f" {AREA}")[2]


def _name(choice: Choice | None) -> str:
    """Return the chosen sensor without its exponent."""
    if choice is None or not choice.worthwhile:
        return "none"
    return choice.enough.label.partition(f" {AREA}")[0]
