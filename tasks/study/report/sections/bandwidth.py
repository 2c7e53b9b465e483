"""Compare event rates with the bus bandwidth of real cameras."""

from __future__ import annotations

from collections.abc import Sequence

from sensor.presets import SensorPreset
from tasks.study.report.table import Table, Text, cutoff_text
from tasks.study.results.bandwidth import Load, bus_loads
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Condition, Scores, base_speed
from tasks.study.results.words import MISSING, PACKAGED, BaseSpeeds, rate_label, speed_label


def buses(scores: Scores, series: Series, base: BaseSpeeds = PACKAGED) -> list[Table]:
    """Collect the bus loads of one series.

    Parameters
    ----------
    scores
        Scores of a run.
    series
        Series that the event rates belong to.
    base
        Speed of the camera at factor 1.

    Returns
    -------
    list of Table
        One table per scene that has cameras of a simulated width, at base speed and at the highest
        speed.
    """
    speeds = list(dict.fromkeys([base_speed(scores, series), max(scores.speeds(series))]))
    tables = [_table(scores, series, scene, speeds, base) for scene in scores.scenes(series)]
    return [table for table in tables if table]


def _table(
    scores: Scores, series: Series, scene: str, speeds: Sequence[float], base: BaseSpeeds
) -> Table | None:
    cutoffs_hz, widths = scores.cutoffs_hz(series), scores.widths(series)
    found: dict[SensorPreset, dict[tuple[float, float], Load]] = {}
    for hz in cutoffs_hz:
        for speed in speeds:
            cells = {w: scores.cell(series, Condition(scene, w, hz, speed)) for w in widths}
            rates_hz = {w: c.event_rate_hz for w, c in cells.items() if c.event_rate_hz is not None}
            for load in bus_loads(rates_hz):
                found.setdefault(load.camera, {})[hz, speed] = load
    if not found:
        return None
    cameras = sorted(found, key=lambda one: (one.model.width, one.max_bandwidth_mev_s))
    rows = {
        Text(one.camera, f"{one.model.width}×{one.model.height}, {one.year}"): [
            [Text(f"{one.max_bandwidth_mev_s:g}")],
            *([_text(found[one].get((hz, speed))) for speed in speeds] for hz in cutoffs_hz),
        ]
        for one in cameras
    }
    heads = [Text("camera"), Text("bus [Mev/s]"), *map(cutoff_text, cutoffs_hz)]
    caption = f"{scene}, at {' → '.join(speed_label(scene, speed, base) for speed in speeds)}"
    return Table("buses", f"Buses, {scene}", caption, heads, {Text(""): rows})


def _text(load: Load | None) -> Text:
    if load is None:
        return Text(MISSING)
    share = f"{100 * load.share:.0f}\u202f%"
    return Text(rate_label(load.rate_hz), share, "" if load.survives else "over")
