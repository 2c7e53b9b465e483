"""Compare scores, event rates and choices across contrast thresholds."""

from __future__ import annotations

from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import Line, Panel, Plot, sensor_keys
from tasks.study.report.sections.tradeoff import score_plot, score_point
from tasks.study.report.table import Rows, Table, Text, cutoff_text, score_text
from tasks.study.results.asked import sensor_of
from tasks.study.results.cells import Condition
from tasks.study.results.choice import choose
from tasks.study.results.metrics import Series
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import MISSING, rate_label, share_text

Comparison = tuple[Plot, Table, Table]


def compare_thresholds(run: FinishedRun, series: Series) -> dict[str, Comparison]:
    """Compare scores of one series, scene by scene."""
    ascending = sorted(run.found, key=lambda scores: scores.contrast_threshold)
    first, metric = run.scores, TASKS[series.task].metric
    speed, sensors = base_speed(first, series), first.sensors(series)
    heads = [Text(f"C = {s.contrast_threshold:g}", "this page" * (s is first)) for s in ascending]
    comparisons = {}
    for scene in first.scenes(series):
        panels: list[Panel] = []
        choices: dict[Text, list[Text]] = {}
        blocks: dict[Text, Rows] = {}
        for hz in first.cutoffs_hz(series):
            where = [Condition(scene, s.width, hz, speed, s.name) for s in sensors]
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
    choice = choose(scores, series, scene, cutoff_hz, speed) if scores.sensors(series) else None
    if choice is None:
        return Text(MISSING, "samples are missing")
    tied = f"tied {choice.tied}" if choice.tied and choice.worthwhile else ""
    return Text(choice.enough.label, tied, "" if choice.worthwhile else "struck")


def _score(scores: Scores, series: Series, where: Condition) -> Text:
    cell, text = scores.cell(series, where), score_text(scores, series, where)
    failed = f", {share_text(cell.failure_share)} fail" if cell.failed.any() else ""
    rate = f"{rate_label(cell.event_rate_hz)} Mev/s{failed}"
    return text if cell.median is None else text._replace(small=rate)
