"""Our medians next to the paper's, a table for each series."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.comparison import ComparisonTable, comparison_table
from tasks.study.results.scores import base_speed


@dataclass(frozen=True, slots=True)
class Comparison:
    """The tables of one series: at base speed, and at every speed."""

    base: ComparisonTable
    every: ComparisonTable


def comparisons(run: FinishedRun) -> list[Comparison]:
    """Collect the section."""
    scores = run.scores
    return [
        Comparison(
            comparison_table(scores, one, [base_speed(scores, one)]), comparison_table(scores, one)
        )
        for one in run.series
    ]
