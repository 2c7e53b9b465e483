"""The points of the trade-off plots, for the page's script and for the static figures."""

from __future__ import annotations

from typing import TypedDict

from tasks.registry import TASKS
from tasks.study.results.intervals import estimate
from tasks.study.results.metrics import METRICS, Series, method_label
from tasks.study.results.scores import Condition, Scores
from tasks.study.results.words import (
    cutoff_detail,
    cutoff_label,
    rate_label,
    share_text,
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
    less_is_better: bool  # labels then stand below the first point: errors rise with speed
    log: bool  # the axis of the scores: errors span decades
    widths: list[int]
    panels: list[Panel]


def plot_data(scores: Scores, series: Series, scene: str) -> Plot:
    """Collect one plot: a panel for each cutoff, a point wherever all samples are there."""
    metric = METRICS[series.metric]
    panels = [_panel(scores, series, scene, cutoff) for cutoff in scores.cutoffs_hz(series)]
    better = "" if metric.higher_is_better else ", less is better"
    values = [point["score"] for panel in panels for point in panel["points"]]
    values += [score for panel in panels for score in panel["baselines"]]
    return {
        "title": f"{scene}, {series.title}",
        "axis": f"{metric.label} [{metric.unit}]{better}",
        "less_is_better": not metric.higher_is_better,
        "log": not metric.higher_is_better and min(values, default=0.0) > 0,
        "widths": scores.widths(series),
        "panels": panels,
    }


def _panel(scores: Scores, series: Series, scene: str, cutoff_hz: float) -> Panel:
    where = [
        Condition(scene, width, cutoff_hz, speed)
        for width in scores.widths(series)
        for speed in scores.speeds(series, scene)
    ]
    baselines = _baselines(scores, series, where)
    points = [_point(scores, series, condition) for condition in where]
    return {
        "label": cutoff_label(cutoff_hz),
        "detail": cutoff_detail(cutoff_hz),
        "points": [point for point in points if point],
        "baselines": baselines,
        "baseline_label": _baseline_label(series, baselines),
    }


def _point(scores: Scores, series: Series, where: Condition) -> Point | None:
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
    paper = scores.published(series, where)
    if paper is not None:
        lines.append(f"paper: {metric.text(paper)} {metric.unit}")
    if cell.failed.any():
        lines.append(f"failed: {share_text(cell.failure_share)}")
    index = scores.widths(series).index(where.width)
    rate_mev_s = cell.event_rate_hz / 1e6
    return {"series": index, "rate": rate_mev_s, "score": cell.median, "lines": lines}


def _baselines(scores: Scores, series: Series, where: list[Condition]) -> list[float]:
    """The different medians of doing nothing over widths and speeds; usually one."""
    cells = [scores.baseline(series, condition) for condition in where]
    return sorted({round(cell.median, 3) for cell in cells if cell.median is not None})


def _baseline_label(series: Series, baselines: list[float]) -> str:
    label = method_label(TASKS[series.task].baseline)
    texts = [METRICS[series.metric].text(score) for score in baselines]
    if len(texts) > 3:
        texts = [f"{texts[0]} to {texts[-1]}"]
    return f"{label} {', '.join(texts)}"
