"""Compare our medians with the paper's, series by series."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.comparison import ComparisonTable, comparison_table
from tasks.study.results.scores import base_speed


@dataclass(frozen=True, slots=True)
class Comparison:
    """Tables of one series: at base speed and at all speeds."""

    base: ComparisonTable
    every: ComparisonTable


def comparisons(run: FinishedRun) -> list[Comparison]:
    """Collect the tables of every series."""
    scores = run.scores
    return [
        Comparison(
            comparison_table(scores, one, [base_speed(scores, one)]), comparison_table(scores, one)
        )
        for one in run.series
    ]
