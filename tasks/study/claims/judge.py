"""The claims that are checked against the rows of a run.

No bound of a claim is fitted to our results.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from tasks.row import Row
from tasks.study.claims.baseline import BEATS_DOING_NOTHING
from tasks.study.claims.claim import Claim
from tasks.study.claims.flow import FLOW_CLAIMS
from tasks.study.claims.reconstruction import RECONSTRUCTION_CLAIMS
from tasks.study.claims.scaling import SCALING_CLAIMS
from tasks.study.claims.slider import ON_RECORDINGS, ON_THE_SLIDER
from tasks.study.claims.tracking import TRACKING_CLAIMS
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.claims.verdict import Status, Verdict
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, by_photoreceptor
from tasks.study.results.slider import PRINTS, is_of_slider

CLAIMS: tuple[Claim, ...] = (
    *SCALING_CLAIMS,
    *RECONSTRUCTION_CLAIMS,
    *FLOW_CLAIMS,
    *TRACKING_CLAIMS,
    ON_THE_SLIDER,
    *TRAINING_CLAIMS,
    BEATS_DOING_NOTHING,
)


def claims_of(config: Mapping[str, Any], scores: Scores) -> tuple[Claim, ...]:
    """Return the claims that a run is about.

    Returns
    -------
    tuple of Claim
        All claims if the sensors and lights are the paper's; else those about training, which is
        our own question. Only claim 22 if the camera was on a slider, real or virtual.
    """
    if "recorded" in config:
        return (ON_RECORDINGS,)
    scenes = scores.scenes()
    if scenes and {*scenes} <= {*PRINTS} and is_of_slider(config):
        return (ON_THE_SLIDER,)
    return CLAIMS if scores.asks_as_paper else TRAINING_CLAIMS


def judge_readings(
    config: Mapping[str, Any],
    readings: Mapping[str, Sequence[Scores]],
    scaling: Mapping[str, Scaling],
) -> dict[str, list[Verdict]]:
    """Judge the claims that a run is about with each photoreceptor.

    Parameters
    ----------
    readings
        Scores of each contrast threshold by photoreceptor; the claims are judged at the first.
    scaling
        The run's scaling statistics by scene. Times between events are those of the first
        photoreceptor, so with others, claims about them are not measured.
    """
    (first, (shown, *_)), *others = readings.items()
    claims = claims_of(config, shown)
    verdicts = judge_all(shown, scaling, claims)
    statuses = {verdict.status for verdict in verdicts}
    if claims is TRAINING_CLAIMS and statuses == {Status.NOT_MEASURED}:
        claims, verdicts = (), []
    without = {scene: replace(numbers, intervals=()) for scene, numbers in scaling.items()}
    rest = {name: judge_all(scores[0], without, claims) for name, scores in others}
    return {first: verdicts, **rest}


def changed_verdicts(verdicts: Mapping[str, Sequence[Verdict]]) -> list[tuple[Verdict, ...]]:
    """Return the verdicts on each claim that are not the same with all photoreceptors.

    A claim that is not measured with one of them is left out.
    """
    return [
        of_claim
        for of_claim in zip(*verdicts.values(), strict=True)
        if len(statuses := {verdict.status for verdict in of_claim}) > 1
        and Status.NOT_MEASURED not in statuses
    ]


def judge_all(
    rows: Iterable[Row] | Scores, scaling: Mapping[str, Scaling], claims: Iterable[Claim] = CLAIMS
) -> list[Verdict]:
    """Judge claims, in the order of their numbers.

    Parameters
    ----------
    rows
        Rows of a run, judged at its first photoreceptor and contrast threshold; or scores.
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
        There are no rows, two are the same, or a task or metric is unknown.
    """
    scores = rows if isinstance(rows, Scores) else next(iter(by_photoreceptor(rows).values()))[0]
    verdicts = [claim.judge(scores, scaling) for claim in claims]
    return sorted(verdicts, key=lambda verdict: verdict.number)
