"""Show from which initial error pose tracking succeeds, and how often each method fails."""

from __future__ import annotations

import numpy as np

from tasks.registry import sigma_mm
from tasks.study.report.plot import Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.report.table import Table, Text, cutoff_text
from tasks.study.results.asked import SensorId, Series
from tasks.study.results.perturbation import TRACKING, sweep
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import MISSING, share_text


def sweeps(scores: Scores) -> dict[str, list[Series]]:
    """Return the series of each tracking method with several perturbations, ascending, by name."""
    methods = dict.fromkeys(s.method for s in scores.series() if s.task == TRACKING.task)
    every = [sweep(scores, method) for method in methods]
    return {sigmas[0]._replace(variant="").name: sigmas for sigmas in every if sigmas[1:]}


def sweep_table(scores: Scores, sigmas: list[Series], scene: str) -> Table:
    """List success and error of one method at base speed."""
    metric, sensors = sigmas[0].spec.metric, scores.sensors(sigmas[0])

    def text(series: Series, of: SensorId, cutoff_hz: float) -> Text:
        cell = scores.cell(series, of.at(scene, cutoff_hz, base_speed(scores, series)))
        if cell.median is None or cell.failure_share is None:
            return Text(MISSING)
        error = f"{metric.text(cell.median)} {metric.unit}"
        return Text(share_text(1 - cell.failure_share), error)

    blocks = {
        cutoff_text(hz): {
            Text(series.variant): [text(series, sensor, hz) for sensor in sensors]
            for series in sigmas
        }
        for hz in scores.cutoffs_hz(sigmas[0])
    }
    caption = f"{scene}: share of successful trials, and median error of all trials"
    heads = [Text(""), *(Text(sensor.label) for sensor in sensors)]
    return Table(caption, heads, blocks)


def sweep_plot(scores: Scores, sigmas: list[Series], name: str) -> Plot:
    """Plot success against perturbation at base speed, over all scenes."""
    sensors = scores.sensors(sigmas[0])
    panels = [
        Panel(*cutoff_text(hz)[:2], [_success_line(scores, sigmas, of, hz) for of in sensors])
        for hz in scores.cutoffs_hz(sigmas[0])
    ]
    title = f"Success over the perturbation, {name}"
    axes = "standard deviation of the perturbation [mm]", "successful trials [%]"
    return plot(title, *axes, sensor_keys(sensors), panels, include_y=(0, 100))


def _success_line(scores: Scores, sigmas: list[Series], of: SensorId, cutoff_hz: float) -> Line:
    points = []
    for series in sigmas:
        at = cutoff_hz, base_speed(scores, series)
        cells = [scores.cell(series, of.at(scene, *at)) for scene in scores.scenes(series)]
        failed = [cell.failed for cell in cells if cell.complete]
        sigma = sigma_mm(series.variant)
        if failed and sigma is not None:
            share = float(1 - np.concatenate(failed).mean())
            lines = [of.label, series.variant, f"{share_text(share)} succeed"]
            points.append(Point(sigma, 100 * share, lines))
    return Line(points)


def failure_table(scores: Scores) -> Table | None:
    """Count the failures of each method that can give up or did fail, by reason; None without
    such a method."""
    rows = {}
    for series in scores.series():
        total, reasons = scores.answers(series), scores.failures(series)
        failed = reasons.total()
        if series.spec.share_column is None and not failed:
            continue
        why = ", ".join(f"{reason} ({count:,})" for reason, count in reasons.most_common(4))
        share = share_text(failed / total if total else None)
        rows[Text(series.title)] = [Text(f"{failed:,} of {total:,}"), Text(share), Text(why)]
    heads = [Text(head) for head in ("method", "failed", "share", "why")]
    caption = "Failures over all conditions"
    return Table(caption, heads, {Text(""): rows}, "failures") if rows else None
