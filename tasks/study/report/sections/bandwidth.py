"""Compare event rates with the bus bandwidth of real cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tasks.study.report.table import Table, Text, cutoff_text
from tasks.study.results.bandwidth import Load, bus_loads
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Condition, Scores, base_speed
from tasks.study.results.words import MISSING, rate_label


@dataclass(frozen=True, slots=True)
class Buses:
    """Bus loads: a table per scene, at base speed and at the highest speed."""

    speeds: list[float]
    tables: list[Table]


def buses(scores: Scores, series: Series) -> Buses:
    """Collect the bus loads of one series.

    Parameters
    ----------
    scores
        Scores of a run.
    series
        Series that the event rates belong to.

    Returns
    -------
    Buses
        Tables of the scenes that have cameras of a simulated width.
    """
    speeds = list(dict.fromkeys([base_speed(scores, series), max(scores.speeds(series))]))
    tables = [_table(scores, series, scene, speeds) for scene in scores.scenes(series)]
    return Buses(speeds, [table for table in tables if table])


def _table(scores: Scores, series: Series, scene: str, speeds: Sequence[float]) -> Table | None:
    cutoffs_hz, widths = scores.cutoffs_hz(series), scores.widths(series)
    loads: dict[tuple[float, float, str], Load] = {}
    for hz in cutoffs_hz:
        for speed in speeds:
            cells = {w: scores.cell(series, Condition(scene, w, hz, speed)) for w in widths}
            rates_hz = {w: c.event_rate_hz for w, c in cells.items() if c.event_rate_hz is not None}
            loads |= {(hz, speed, one.camera.camera): one for one in bus_loads(rates_hz)}
    if not loads:
        return None
    cameras = {one.camera.camera: one.camera for one in loads.values()}.values()
    ordered = sorted(cameras, key=lambda one: (one.model.width, one.max_bandwidth_mev_s))
    rows = {
        Text(one.camera, f"{one.model.width}×{one.model.height}, {one.year}"): [
            [Text(f"{one.max_bandwidth_mev_s:g}")],
            *([_text(loads.get((hz, speed, one.camera))) for speed in speeds] for hz in cutoffs_hz),
        ]
        for one in ordered
    }
    heads = [Text("camera"), Text("bus [Mev/s]"), *map(cutoff_text, cutoffs_hz)]
    return Table("buses", f"Buses, {scene}", scene, heads, {Text(""): rows})


def _text(load: Load | None) -> Text:
    if load is None:
        return Text(MISSING)
    share = f"{100 * load.share:.0f}\u202f%"
    return Text(rate_label(load.rate_hz), share, "" if load.survives else "over")
