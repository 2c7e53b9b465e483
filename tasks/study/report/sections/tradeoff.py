"""Score against event rate, and what the buses of real cameras carry."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.evaluation.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.sections.bandwidth import Buses, buses
from tasks.study.report.tradeoff import Plot, plot_data


@dataclass(frozen=True, slots=True)
class Tradeoff:
    """The plots of each series, their names by task and index, and the first series' buses."""

    plots: list[list[Plot]]
    picker: dict[str, dict[int, str]]
    buses: Buses


def tradeoff(run: FinishedRun) -> Tradeoff:
    """Collect the section."""
    scores = run.scores
    plots = [[plot_data(scores, one, s) for s in scores.scenes(one)] for one in run.series]
    picker: dict[str, dict[int, str]] = {}
    for index, one in enumerate(run.series):
        picker.setdefault(TASKS[one.task].title, {})[index] = one.name
    return Tradeoff(plots, picker, buses(scores, run.series[0]))
