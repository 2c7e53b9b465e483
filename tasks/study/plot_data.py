"""The points of the trade-off plots, for the page's script and for the static figure."""

from __future__ import annotations

from typing import TypedDict

from tasks.study.judging import estimate
from tasks.study.paper import published
from tasks.study.tables import (
    BASELINES,
    METRICS,
    Condition,
    Scores,
    Series,
    cutoff_detail,
    cutoff_label,
    number_text,
    rate_label,
    speed_label,
)


class Point(TypedDict):
    """One resolution at one speed: event rate in Mev/s, score, and the lines of its tooltip."""

    series: int  # index into the plot's widths
    rate: float
    score: float
    lines: list[str]


class Panel(TypedDict):
    """One cutoff; `baselines` are the different scores of doing nothing, usually one."""

    label: str
    detail: str
    points: list[Point]
    baselines: list[float]
    baseline_label: str


class Plot(TypedDict):
    """One series on one scene; `widths` in px, ascending."""

    title: str
    axis: str
    widths: list[int]
    panels: list[Panel]


def plot_data(scores: Scores, series: Series, scene: str) -> Plot:
    """Collect one plot: a panel for each cutoff, a point wherever all samples are there."""
    metric = METRICS[series.metric]
    return {
        "title": f"{scene}, {series.title}",
        "axis": f"{metric.label} [{metric.unit}]",
        "widths": scores.widths(series),
        "panels": [_panel(scores, series, scene, cutoff) for cutoff in scores.cutoffs_hz(series)],
    }


def _panel(scores: Scores, series: Series, scene: str, cutoff_hz: float) -> Panel:
    baselines = _baselines(scores, series, scene, cutoff_hz)
    values = [number_text(score, METRICS[series.metric].decimals) for score in baselines]
    points = [
        _point(scores, series, index, Condition(scene, width, cutoff_hz, speed))
        for index, width in enumerate(scores.widths(series))
        for speed in scores.speeds(series)
    ]
    return {
        "label": cutoff_label(cutoff_hz),
        "detail": cutoff_detail(cutoff_hz),
        "points": [point for point in points if point],
        "baselines": baselines,
        "baseline_label": f"{BASELINES[series.task].replace('_', ' ')} {', '.join(values)}",
    }


def _point(scores: Scores, series: Series, index: int, where: Condition) -> Point | None:
    """Collect one point, or None where samples are missing or there were no events."""
    cell = scores.cell(series, where)
    if cell.median is None or not cell.event_rate_hz:
        return None
    metric = METRICS[series.metric]
    interval = estimate({where: cell}, lambda medians: medians[where])
    lines = [
        f"{where.width} px",
        f"{cutoff_label(where.cutoff_hz)}, {speed_label(where.scene, where.speed)}",
        f"{metric.label} {interval.text(metric.decimals, '', metric.unit)}",
        f"{rate_label(cell.event_rate_hz)} Mev/s",
    ]
    scene, width, cutoff_hz, speed = where
    paper = published(scene, *series[:2], width, cutoff_hz, speed, series.metric)
    if paper is not None:
        lines.append(f"paper: {number_text(paper, metric.decimals)} {metric.unit}")
    rate_mev_s = cell.event_rate_hz / 1e6
    return {"series": index, "rate": rate_mev_s, "score": cell.median, "lines": lines}


def _baselines(scores: Scores, series: Series, scene: str, cutoff_hz: float) -> list[float]:
    """The different medians of doing nothing over the speeds; usually one."""
    cells = [scores.baseline(series, scene, cutoff_hz, s) for s in scores.speeds(series)]
    return sorted({round(cell.median, 3) for cell in cells if cell.median is not None})
