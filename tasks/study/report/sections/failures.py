"""Show from which initial error pose tracking succeeds, and how often each method fails."""

from __future__ import annotations

import numpy as np

from tasks.registry import TASKS
from tasks.study.report.plot import Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.report.table import Table, Text, cutoff_text
from tasks.study.results.asked import SensorId
from tasks.study.results.cells import Condition
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import TRACKING, sweep
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import MISSING, share_text
from tasks.variants import sigma_mm


def sweeps(scores: Scores) -> dict[str, list[Series]]:
    """Return the series of each tracking method with several perturbations, ascending, by name."""
    methods = dict.fromkeys(one.method for one in scores.series() if one.task == TRACKING.task)
    found = [sweep(scores, method) for method in methods]
    return {of_one[0]._replace(variant="").name: of_one for of_one in found if of_one[1:]}


def sweep_table(scores: Scores, found: list[Series], scene: str) -> Table:
    """List success and error of one method at base speed."""
    metric, sensors = TASKS[found[0].task].metric, scores.sensors(found[0])

    def text(series: Series, of: SensorId, cutoff_hz: float) -> Text:
        where = Condition(scene, of.width, cutoff_hz, base_speed(scores, series), of.name)
        cell = scores.cell(series, where)
        if cell.median is None or cell.failure_share is None:
            return Text(MISSING)
        error = f"{metric.text(cell.median)} {metric.unit}"
        return Text(share_text(1 - cell.failure_share), error)

    blocks = {
        cutoff_text(hz): {
            Text(one.variant): [text(one, sensor, hz) for sensor in sensors] for one in found
        }
        for hz in scores.cutoffs_hz(found[0])
    }
    caption = f"{scene}: share of successful trials, and median error of all trials"
    heads = [Text(""), *(Text(sensor.label) for sensor in sensors)]
    return Table(caption, heads, blocks)


def sweep_plot(scores: Scores, found: list[Series], name: str) -> Plot:
    """Plot success against perturbation at base speed, over all scenes."""
    sensors = scores.sensors(found[0])
    panels = [
        Panel(*cutoff_text(hz)[:2], [_success_line(scores, found, one, hz) for one in sensors])
        for hz in scores.cutoffs_hz(found[0])
    ]
    title = f"Success over the perturbation, {name}"
    axes = "standard deviation of the perturbation [mm]", "successful trials [%]"
    return plot(title, *axes, sensor_keys(sensors), panels, include_y=(0, 100))


def _success_line(scores: Scores, found: list[Series], of: SensorId, cutoff_hz: float) -> Line:
    shares = {one: _pooled_success(scores, one, of, cutoff_hz) for one in found}
    points = [
        Point(x, 100 * share, [of.label, one.variant, f"{share_text(share)} succeed"])
        for one, share in shares.items()
        if share is not None and (x := sigma_mm(one.variant)) is not None
    ]
    return Line(points)


def _pooled_success(scores: Scores, series: Series, of: SensorId, cutoff_hz: float) -> float | None:
    at = of.width, cutoff_hz, base_speed(scores, series), of.name
    cells = [scores.cell(series, Condition(scene, *at)) for scene in scores.scenes(series)]
    failed = [cell.failed for cell in cells if cell.complete]
    return float(1 - np.concatenate(failed).mean()) if failed else None


def failure_table(scores: Scores) -> Table | None:
    """Count the failures of each method that can give up or did fail, by reason; None without
    such a method."""
    rows = {}
    for one in scores.series():
        total = scores.answers(one)
        reasons = scores.failures(one)
        failed = reasons.total()
        if TASKS[one.task].share_column is None and not failed:
            continue
        why = ", ".join(f"{reason} ({count:,})" for reason, count in reasons.most_common(4))
        share = share_text(failed / total if total else None)
        rows[Text(one.title)] = [Text(f"{failed:,} of {total:,}"), Text(share), Text(why)]
    heads = [Text(head) for head in ("method", "failed", "share", "why")]
    caption = "Failures over all conditions"
    return Table(caption, heads, {Text(""): rows}, "failures") if rows else None
