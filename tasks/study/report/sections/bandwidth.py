"""Event rates beside what the buses of real cameras carry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sensor.presets import SensorPreset
from tasks.study.results.bandwidth import Load, bus_loads
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Condition, Scores, base_speed


@dataclass(frozen=True, slots=True)
class BusTable:
    """One scene: for each camera, and each cutoff, its bus's load at each speed."""

    scene: str
    lines: list[tuple[SensorPreset, list[list[Load | None]]]]


@dataclass(frozen=True, slots=True)
class Buses:
    """A table for each scene, at base speed and at the highest."""

    speeds: list[float]
    cutoffs_hz: list[float]
    tables: list[BusTable]


def buses(scores: Scores, series: Series) -> Buses:
    """Collect the loads that one series puts on the buses of real cameras."""
    cutoffs_hz = scores.cutoffs_hz(series)
    speeds = list(dict.fromkeys([base_speed(scores, series), max(scores.speeds(series))]))
    tables = [_table(scores, series, s, cutoffs_hz, speeds) for s in scores.scenes(series)]
    return Buses(speeds, cutoffs_hz, [table for table in tables if table.lines])


def _table(
    scores: Scores,
    series: Series,
    scene: str,
    cutoffs_hz: Sequence[float],
    speeds: Sequence[float],
) -> BusTable:
    loads = {
        (cutoff_hz, speed, load.camera): load
        for cutoff_hz in cutoffs_hz
        for speed in speeds
        for load in bus_loads(_rates_hz(scores, series, scene, cutoff_hz, speed))
    }
    cameras = sorted(
        dict.fromkeys(camera for _, _, camera in loads),
        key=lambda camera: (camera.model.width, camera.max_bandwidth_mev_s),
    )
    lines = [
        (camera, [[loads.get((c, speed, camera)) for speed in speeds] for c in cutoffs_hz])
        for camera in cameras
    ]
    return BusTable(scene, lines)


def _rates_hz(
    scores: Scores, series: Series, scene: str, cutoff_hz: float, speed: float
) -> dict[int, float]:
    """Median event rates of the widths that have all samples."""
    cells = {
        width: scores.cell(series, Condition(scene, width, cutoff_hz, speed)).event_rate_hz
        for width in scores.widths(series)
    }
    return {width: rate for width, rate in cells.items() if rate is not None}
