"""The claims that are checked against the rows of a run.

No bound of a claim is fitted to our results.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tasks.row import Row
from tasks.study.claims.baseline import BEATS_DOING_NOTHING
from tasks.study.claims.claim import Claim
from tasks.study.claims.dense_flow import DENSE_FLOW_CLAIMS
from tasks.study.claims.flow import FLOW_CLAIMS
from tasks.study.claims.reconstruction import RECONSTRUCTION_CLAIMS
from tasks.study.claims.scaling import SCALING_CLAIMS
from tasks.study.claims.slider import ON_RECORDINGS, ON_THE_SLIDER
from tasks.study.claims.tracking import TRACKING_CLAIMS
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.claims.verdict import Verdict
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores
from tasks.study.results.slider import PRINTS

CLAIMS: tuple[Claim, ...] = (
    *SCALING_CLAIMS,
    *RECONSTRUCTION_CLAIMS,
    *FLOW_CLAIMS,
    *DENSE_FLOW_CLAIMS,
    *TRACKING_CLAIMS,
    ON_THE_SLIDER,
    *TRAINING_CLAIMS,
    BEATS_DOING_NOTHING,
)


def claims_of(config: Mapping[str, Any], scenes: Iterable[str]) -> tuple[Claim, ...]:
    """Return the claims that a run is about.

    Parameters
    ----------
    config
        The content of its study.json.
    scenes
        The scenes of its rows.

    Returns
    -------
    tuple of Claim
        All claims, or only claim 22 if the camera was on a slider, real or virtual.
    """
    if "recorded" in config:
        return (ON_RECORDINGS,)
    return (ON_THE_SLIDER,) if set(scenes) <= set(PRINTS) else CLAIMS


def judge_all(
    rows: Iterable[Row] | Scores,
    scaling: Mapping[str, Scaling],
    claims: Iterable[Claim] = CLAIMS,
) -> list[Verdict]:
    """Judge claims, in the order of their numbers.

    Parameters
    ----------
    rows
        The rows of a run, or its scores.
    scaling
        The run's scaling statistics by scene; claims 1 and 2 are not measured without them.
    claims
        The claims to judge; by default those of the paper and our own.

    Returns
    -------
    list of Verdict
        A verdict for each claim.

    Raises
    ------
    ResultError
        As `Scores` raises it.
    """
    scores = rows if isinstance(rows, Scores) else Scores(rows)
    found = [claim.judge(scores, scaling) for claim in claims]
    return sorted(found, key=lambda verdict: verdict.number)
