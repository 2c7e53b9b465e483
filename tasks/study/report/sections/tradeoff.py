"""Plot scores against event rates."""

from __future__ import annotations

from collections.abc import Sequence

from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import Key, Limit, Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.report.table import cutoff_text
from tasks.study.results.asked import sensor_of
from tasks.study.results.cells import Condition
from tasks.study.results.intervals import estimate
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores
from tasks.study.results.words import cutoff_label, rate_label, share_text, speed_label


def tradeoff_plots(run: FinishedRun, series: Series) -> dict[str, Plot]:
    """Plot one series: a panel per cutoff, a point per condition that has all samples."""
    scores, plots = run.scores, {}
    for scene in scores.scenes(series):
        keys = sensor_keys(scores.sensors(series, scene), labeled=True)
        panels = [_panel(run, series, scene, hz) for hz in scores.cutoffs_hz(series)]
        plots[scene] = score_plot(run, f"{scene}, {series.title}", series, keys, panels)
    return plots


def score_plot(
    run: FinishedRun, title: str, series: Series, keys: Sequence[Key], panels: Sequence[Panel]
) -> Plot:
    """Plot scores of one series against event rates; errors have a logarithmic axis.

    Parameters
    ----------
    panels
        One panel per cutoff; x is Mev/s, y is the score in the unit of the metric.
    """
    metric = TASKS[series.task].metric
    errors = not metric.higher_is_better
    better = ", less is better" if errors else ""
    axes = "event rate [Mev/s]", f"{metric.label} [{metric.unit}]{better}"
    return plot(
        *(title, *axes, keys, panels),
        log_y=errors,
        labels_below=errors,  # as errors rise with speed
        limit=Limit(run.bus_hz / 1e6, f"bus {run.bus_hz / 1e6:g} Mev/s"),
        deciding=metric.negligible,
    )


def _panel(run: FinishedRun, series: Series, scene: str, cutoff_hz: float) -> Panel:
    scores, lines, baselines = run.scores, [], set()
    for sensor in scores.sensors(series, scene):
        where = [
            Condition(scene, sensor.width, cutoff_hz, speed, sensor.name)
            for speed in scores.speeds(series, scene)
        ]
        lines.append(Line([p for at in where if (p := score_point(run, scores, series, at))]))
        idle = [scores.baseline(series, at).median for at in where]
        baselines |= {round(median, 3) for median in idle if median is not None}
    as_text = TASKS[series.task].metric.text
    texts = list(dict.fromkeys(as_text(score) for score in sorted(baselines)))
    if len(texts) > 3:
        texts = [f"{texts[0]} to {texts[-1]}"]
    label = f"{TASKS[series.task].label(TASKS[series.task].baseline)} {', '.join(texts)}"
    return Panel(*cutoff_text(cutoff_hz)[:2], lines, sorted(baselines), label)


def score_point(run: FinishedRun, scores: Scores, series: Series, where: Condition) -> Point | None:
    """Make one point of some of the run's scores."""
    cell = scores.cell(series, where)
    if cell.median is None or not cell.event_rate_hz:
        return None
    metric = TASKS[series.task].metric
    interval = estimate(lambda medians: medians[where], {where: cell})
    speed = speed_label(where.scene, where.speed, run.base_speeds)
    lines = [
        sensor_of(where).label,
        f"{cutoff_label(where.cutoff_hz)}, {speed}",
        f"{metric.label} {interval.text(metric.decimals, '', metric.unit)}",
        f"{rate_label(cell.event_rate_hz)} Mev/s",
    ]
    paper = scores.published(series, where)
    if paper is not None:
        lines.append(f"paper: {metric.text(paper)} {metric.unit}")
    if cell.failed.any():
        lines.append(f"failed: {share_text(cell.failure_share)}")
    return Point(cell.event_rate_hz / 1e6, cell.median, lines)
