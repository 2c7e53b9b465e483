"""Every claim that is checked against the rows of a run.

A claim is one function from scores to a `Verdict`, in the file of its task; `verdict` says how one
comes about. No threshold is fitted to our results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from tasks.row import Row
from tasks.study.claims.baseline import every_method_beats_doing_nothing
from tasks.study.claims.flow import FLOW_CLAIMS
from tasks.study.claims.reconstruction import RECONSTRUCTION_CLAIMS
from tasks.study.claims.scaling import SCALING_CLAIMS
from tasks.study.claims.tracking import TRACKING_CLAIMS
from tasks.study.claims.verdict import Verdict
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores

CLAIMS: tuple[Callable[[Scores], Verdict], ...] = (
    *RECONSTRUCTION_CLAIMS,
    *FLOW_CLAIMS,
    *TRACKING_CLAIMS,
    every_method_beats_doing_nothing,
)


def judge_all(rows: Iterable[Row] | Scores, scaling: Mapping[str, Scaling]) -> list[Verdict]:
    """Judge every claim that is implemented, in the order of their numbers.

    Parameters
    ----------
    rows
        The rows of a run, or its scores.
    scaling
        The run's scaling statistics by scene; where there are none, their claims are not measured.

    Raises
    ------
    ResultError
        As `Scores`: no rows, an unknown task or metric, or a value that is there twice.
    """
    scores = rows if isinstance(rows, Scores) else Scores(rows)
    about_scaling = [claim(scores, scaling) for claim in SCALING_CLAIMS]
    about_scores = [claim(scores) for claim in CLAIMS]
    return sorted(about_scaling + about_scores, key=lambda verdict: verdict.number)
