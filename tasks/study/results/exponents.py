"""Whether the choice of a sensor hangs on the exponent of the area in a cutoff that is lent."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from tasks.study.results.asked import SensorId
from tasks.study.results.choice import Choice, choose_all
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores
from tasks.study.results.words import BaseSpeeds, cutoff_label, join_words, speed_label
from tasks.study.sensors import AREA


def exponents_text(scores: Scores, series: Iterable[Series], base: BaseSpeeds) -> list[str]:
    """Say for each series in how many conditions the choice is the same at all exponents."""
    lines = []
    for one in series:
        parts = [sensor.name.partition(f" {AREA}") for sensor in scores.sensors(one)]
        powers = sorted({power for _, found, power in parts if found}, key=float)
        if len(powers) < 2:
            continue
        at = {power: choose_all(scores, one, _among(power)) for power in powers}
        found = {where: [_name(at[power][where]) for power in powers] for where in at[powers[0]]}
        differing = {where: names for where, names in found.items() if len({*names}) > 1}
        text = (
            f"{one.title}: at exponents {join_words(powers)} of the photodiode's area, the choice "
            f"is the same in {len(found) - len(differing)} of {len(found)} conditions"
        )
        for (scene, cutoff_hz, speed), names in differing.items():
            chosen = [f"{name} at {power}" for name, power in zip(names, powers, strict=True)]
            place = f"{scene}, {cutoff_label(cutoff_hz)}, {speed_label(scene, speed, base)}"
            text += f"; {place}: {join_words(chosen)}"
        lines.append(f"{text}.")
    return lines


def _among(power: str) -> Callable[[SensorId], bool]:
    """Return whether a sensor is one at this exponent, or lends no cutoff."""

    def among(sensor: SensorId) -> bool:
        _, lent, own = sensor.name.partition(f" {AREA}")
        return not lent or own == power

    return among


def _name(choice: Choice | None) -> str:
    """Return the chosen sensor without its exponent."""
    if choice is None or not choice.worthwhile:
        return "none"
    return choice.enough.label.partition(f" {AREA}")[0]
