"""The claims that are checked against the rows of a run, and the function that judges them.

No bound of a claim is fitted to our results.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tasks.row import Row
from tasks.study.claims.baseline import BEATS_DOING_NOTHING
from tasks.study.claims.claim import Claim
from tasks.study.claims.flow import FLOW_CLAIMS
from tasks.study.claims.reconstruction import RECONSTRUCTION_CLAIMS
from tasks.study.claims.scaling import SCALING_CLAIMS
from tasks.study.claims.tracking import TRACKING_CLAIMS
from tasks.study.claims.verdict import Verdict, status_of
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores

CLAIMS: tuple[Claim, ...] = (
    *SCALING_CLAIMS,
    *RECONSTRUCTION_CLAIMS,
    *FLOW_CLAIMS,
    *TRACKING_CLAIMS,
    BEATS_DOING_NOTHING,
)


def judge(claim: Claim, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
    """Judge one claim.

    Parameters
    ----------
    claim
        What the paper says.
    scores
        The scores of a run.
    scaling
        The run's scaling statistics by scene; claims 1 and 2 are not measured without them.

    Returns
    -------
    Verdict
        Whether the claim holds, with our numbers and the paper's.
    """
    found = claim.evidence(scores, scaling)
    return Verdict(
        number=claim.number,
        title=claim.title,
        statement=claim.statement,
        status=status_of(found.outcomes),
        ours=found.ours,
        paper=found.paper,
        note=f"{claim.note} {found.scope}".strip(),
    )


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
        As `judge` takes it.
    claims
        The claims to judge; by default those of the paper and our own.

    Returns
    -------
    list of Verdict
        A verdict for each claim.

    Raises
    ------
    ResultError
        As `Scores`: no rows, an unknown task or metric, or a value that is there twice.
    """
    scores = rows if isinstance(rows, Scores) else Scores(rows)
    found = [judge(claim, scores, scaling) for claim in claims]
    return sorted(found, key=lambda verdict: verdict.number)
