"""Format conditions and numbers for the terminal and the report."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from decimal import Decimal

from tasks.study.results.asked import CutoffInLux, MetersPerSecond, SensorId
from tasks.study.results.paper import BASE_SPEED_M_PER_S, CUTOFFS_HZ

MISSING = "–"

BaseSpeeds = Mapping[str, float]
"""Speed of the camera at factor 1, m/s, by scene."""

PACKAGED: BaseSpeeds = BASE_SPEED_M_PER_S


_OF_THE_PAPER = dict(zip(CUTOFFS_HZ, ("ideal", "day", "night"), strict=True))


def cutoff_label(cutoff_hz: float) -> str:
    """Name a light as in the paper (ideal, day, night), in lux if the study gives lux, or in Hz."""
    if isinstance(cutoff_hz, CutoffInLux):
        return f"{cutoff_hz.illuminance_lux:g} lux"
    return _OF_THE_PAPER.get(cutoff_hz, f"{cutoff_hz:g} Hz")


def cutoff_detail(cutoff_hz: float) -> str:
    """Say what `cutoff_label` does not say of a cutoff."""
    if math.isinf(cutoff_hz):
        return "no cutoff"
    frequency = f"{cutoff_hz:g} Hz"
    return "cutoff" if cutoff_label(cutoff_hz) == frequency else f"cutoff {frequency}"


def speed_label(scene: str, speed: float, base: BaseSpeeds = PACKAGED) -> str:
    """Format a speed in m/s, or as a factor if no base speed is known or the camera is at rest."""
    if isinstance(speed, MetersPerSecond):
        return f"{speed:g} m/s"
    fast = base.get(scene, 0.0) * speed
    if not fast:
        return f"speed {speed:.2g}"
    return f"{fast:.2g} m/s" if fast < 10 else f"{fast:.0f} m/s"


def setting_label(scene: str, cutoff_hz: float, speed: float, base: BaseSpeeds) -> str:
    """Name a light and a speed, as in "day, 0.9 m/s"."""
    return f"{cutoff_label(cutoff_hz)}, {speed_label(scene, speed, base)}"


def distances_label(distances_m: Mapping[str, float]) -> str:
    """List distances of cameras, m, by scene."""
    return ", ".join(f"{scene} {distance_m:.3g} m" for scene, distance_m in distances_m.items())


def photoreceptor_label(photoreceptor: str) -> str:
    """Name a photoreceptor in words, or the program in its place, such as "v2e-A-1px"."""
    words = {"two_pole": "two poles", "one_pole": "one pole", "v2e": "v2e's limit for small steps"}
    program = re.sub("-(.+)-(.+)px", r" \1, \2 px a frame", photoreceptor)
    return words.get(photoreceptor, program)


def rate_label(event_rate_hz: float | None) -> str:
    """Format an event rate in Mev/s to about three digits, two below 0.1 Mev/s."""
    if event_rate_hz is None or not math.isfinite(event_rate_hz):
        return MISSING
    mega = event_rate_hz / 1e6
    if 0 < mega < 0.1:
        return f"{Decimal(f'{mega:.2g}'):f}"
    return f"{mega:.{0 if mega >= 100 else 1 if mega >= 10 else 2}f}"


def share_text(share: float | None) -> str:
    """Format a share in percent; only exact 0 and 1 are printed as 0 % and 100 %."""
    if share is None:
        return MISSING
    percent = round(100 * share)
    if 0 < share < 1:
        percent = min(max(percent, 1), 99)
    return f"{percent}\u202f%"


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Join words as in "carpet, rocks and room"."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def capitalized(text: str) -> str:
    """Return a text with its first letter in upper case."""
    return text[:1].upper() + text[1:]


def lost_text(dropped: Mapping[SensorId, float]) -> str:
    """List the share of events that each sensor's bus lost; of many, those with a loss alone."""
    lost = {sensor: share for sensor, share in sorted(dropped.items()) if share >= 0.005}
    listed = lost if len(dropped) > _MOST_LISTED else dict(sorted(dropped.items()))
    texts = [f"{sensor.label} {share_text(share)}" for sensor, share in listed.items()]
    if len(listed) < len(dropped):
        others = f"the other {len(dropped) - len(listed)}" if listed else "all"
        texts.append(f"{others} less than 0.5\u202f%")
    return ", ".join(texts)


def buses_text(buses_hz: Mapping[SensorId, float], own_hz: Mapping[SensorId, float]) -> str:
    """List the bus of each sensor, and say which have none of their own; of many, count them."""
    note = " (none of its own; that of a real camera)"
    if len(buses_hz) <= _MOST_LISTED:
        return ", ".join(
            f"{sensor.label} {hz / 1e6:g} Mev/s{'' if sensor in own_hz else note}"
            for sensor, hz in buses_hz.items()
        )
    counts = Counter(own_hz.values())
    texts = [f"{hz / 1e6:g} Mev/s for {count} sensors" for hz, count in sorted(counts.items())]
    without = {sensor: hz for sensor, hz in buses_hz.items() if sensor not in own_hz}
    if without:
        usual = max(without.values()) / 1e6
        texts.append(f"{usual:g} Mev/s, that of a real camera, for {len(without)} that have none")
    return ", ".join(texts)


_MOST_LISTED = 8
