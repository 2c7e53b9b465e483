"""Plot scores against event rates: of each speed, and of each contrast threshold."""

from __future__ import annotations

from collections.abc import Sequence

from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import Key, Limit, Line, Panel, Plot, Point, plot, sensor_keys
from tasks.study.report.table import Rows, Table, Text, cutoff_text, score_text
from tasks.study.results.asked import Condition, Series, sensor_of
from tasks.study.results.choice import choose
from tasks.study.results.intervals import estimate
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import MISSING, rate_label, setting_label, share_text


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
    """Plot scores of a series against event rates, Mev/s; errors have a logarithmic axis."""
    metric = series.spec.metric
    errors = not metric.higher_is_better
    better = ", less is better" if errors else ""
    axes = "event rate [Mev/s]", f"{metric.label} [{metric.unit}]{better}"
    return plot(
        title,
        *axes,
        keys,
        panels,
        log_y=errors,
        labels_below=errors,  # as errors rise with speed
        limit=Limit(run.bus_hz / 1e6, f"bus {run.bus_hz / 1e6:g} Mev/s"),
        deciding=metric.negligible,
    )


def _panel(run: FinishedRun, series: Series, scene: str, cutoff_hz: float) -> Panel:
    scores, lines, baselines = run.scores, [], set()
    for sensor in scores.sensors(series, scene):
        where = [sensor.at(scene, cutoff_hz, speed) for speed in scores.speeds(series, scene)]
        lines.append(Line([p for at in where if (p := score_point(run, scores, series, at))]))
        idle = [scores.baseline(series, at).median for at in where]
        baselines |= {round(median, 3) for median in idle if median is not None}
    as_text = series.spec.metric.text
    texts = list(dict.fromkeys(as_text(score) for score in sorted(baselines)))
    if len(texts) > 3:
        texts = [f"{texts[0]} to {texts[-1]}"]
    label = f"{series.spec.label(series.spec.baseline)} {', '.join(texts)}"
    return Panel(*cutoff_text(cutoff_hz)[:2], lines, sorted(baselines), label)


def score_point(run: FinishedRun, scores: Scores, series: Series, where: Condition) -> Point | None:
    """Make one point of some of the run's scores."""
    cell = scores.cell(series, where)
    if cell.median is None or not cell.event_rate_hz:
        return None
    metric = series.spec.metric
    interval = estimate(lambda medians: medians[where], {where: cell})
    lines = [
        sensor_of(where).label,
        setting_label(where.scene, where.cutoff_hz, where.speed, run.base_speeds),
        f"{metric.label} {interval.text(metric.decimals, '', metric.unit)}",
        f"{rate_label(cell.event_rate_hz)} Mev/s",
    ]
    if (paper := scores.published(series, where)) is not None:
        lines.append(f"paper: {metric.text(paper)} {metric.unit}")
    if cell.failed.any():
        lines.append(f"failed: {share_text(cell.failure_share)}")
    return Point(cell.event_rate_hz / 1e6, cell.median, lines)


def compare_thresholds(run: FinishedRun, series: Series) -> dict[str, tuple[Plot, Table, Table]]:
    """Compare scores of one series, scene by scene."""
    ascending = sorted(run.by_threshold, key=lambda scores: scores.contrast_threshold)
    first, metric = run.scores, series.spec.metric
    speed, sensors = base_speed(first, series), first.sensors(series)
    heads = [Text(f"C = {s.contrast_threshold:g}", "this page" * (s is first)) for s in ascending]
    comparisons = {}
    for scene in first.scenes(series):
        panels: list[Panel] = []
        choices: dict[Text, list[Text]] = {}
        blocks: dict[Text, Rows] = {}
        for hz in first.cutoffs_hz(series):
            where = [s.at(scene, hz, speed) for s in sensors]
            points = [[score_point(run, s, series, at) for s in ascending] for at in where]
            light = cutoff_text(hz)
            panels.append(Panel(*light[:2], [Line([*filter(None, line)]) for line in points]))
            choices[light] = [_enough(s, series, scene, hz, speed) for s in ascending]
            blocks[light] = {
                Text(sensor_of(at).label): [_score(scores, series, at) for scores in ascending]
                for at in where
            }
        caption = (
            f"{scene}: median {metric.heading}, and million events per second; struck out: no "
            "better than doing nothing"
        )
        by_threshold = f"by contrast threshold, {scene}"
        comparisons[scene] = (
            score_plot(run, f"Scores {by_threshold}", series, sensor_keys(sensors), panels),
            Table(f"Choice {by_threshold}", [Text(""), *heads], {Text(""): choices}),
            Table(caption, [Text("sensor"), *heads], blocks),
        )
    return comparisons


def _enough(scores: Scores, series: Series, scene: str, cutoff_hz: float, speed: float) -> Text:
    choice = choose(scores, series, scene, cutoff_hz, speed)
    if choice is None:
        return Text(MISSING, "samples are missing")
    tied = f"tied {choice.tied}" if choice.tied and choice.worthwhile else ""
    return Text(choice.enough.label, tied, "" if choice.worthwhile else "struck")


def _score(scores: Scores, series: Series, where: Condition) -> Text:
    cell, text = scores.cell(series, where), score_text(scores, series, where)
    failed = f", {share_text(cell.failure_share)} fail" if cell.failed.any() else ""
    rate = f"{rate_label(cell.event_rate_hz)} Mev/s{failed}"
    return text if cell.median is None else text._replace(small=rate)
