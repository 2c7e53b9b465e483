"""The claims that are checked against the rows of a run: those of the paper, and our own about what
beats doing nothing.

No bound of a claim is fitted to our results.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tasks.row import Row
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.flow import FLOW_CLAIMS
from tasks.study.claims.reconstruction import RECONSTRUCTION_CLAIMS
from tasks.study.claims.slider import ON_RECORDINGS, ON_THE_SLIDER
from tasks.study.claims.tracking import TRACKING_CLAIMS
from tasks.study.claims.training import TRAINING_CLAIMS
from tasks.study.claims.verdict import Status, Verdict, settled
from tasks.study.results.asked import Condition, Series
from tasks.study.results.intervals import lead_over
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, base_speed, by_photoreceptor
from tasks.study.results.slider import PRINTS, is_of_slider
from tasks.study.results.words import cutoff_label


@dataclass(frozen=True, kw_only=True)
class BaselineClaim(Claim):
    """Methods are better than their starting point, method by method and light by light."""

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Count the cells in which each method is better."""
        shown = [series for series in shown_series(scores) if series.is_method]
        counts = [scores.samples(s, scene) for s in shown for scene in scores.scenes(s)]
        scope = scope_text(samples=min(counts, default=None))
        lines = [f"{series.title}: {_by_light(scores, series)}" for series in shown]
        outcomes = [Status.NO_VERDICT if shown else Status.NOT_MEASURED]
        ours = "\n".join(lines) or "no rows of any method"
        return self.verdict(outcomes, ours, "not reported", scope)


BEATS_DOING_NOTHING = BaselineClaim(
    number=24,
    why="What needs event times fails when they are late.",
    title="Methods beat doing nothing",
    statement="The score is better than that of the image, flow or path that the method starts "
    "from.",
    note="Our own check: a score that does not beat its starting point says nothing about the "
    "resolution. A cell is a width on a scene at a speed; the median difference of its samples "
    "decides, without correction for the number of cells. Ideal light counts once, at base speed: "
    "ideal pixels send the same events at every speed.",
)


def _by_light(scores: Scores, series: Series) -> str:
    """Say in how many cells of each light a method is better, worse, or neither."""
    base = base_speed(scores, series)
    lights: dict[float, Counter[Status]] = {}
    for where in scores.conditions(series):
        if where.cutoff_hz != math.inf or where.speed == base:
            outcome = _outcome(scores, series, where)
            lights.setdefault(where.cutoff_hz, Counter())[outcome] += 1
    return "; ".join(f"{cutoff_label(hz)} {_text(lights[hz])}" for hz in sorted(lights)[::-1])


def _text(count: Counter[Status]) -> str:
    others = Status.DOES_NOT_HOLD, Status.UNDECIDED, Status.NOT_MEASURED
    words = {Status.DOES_NOT_HOLD: "worse"}
    rest = [f", {count[status]} {words.get(status, status)}" for status in others if count[status]]
    return f"{count[Status.HOLDS]} of {count.total()}{''.join(rest)}"


def _outcome(scores: Scores, series: Series, where: Condition) -> Status:
    ours, nothing = scores.cell(series, where), scores.baseline(series, where)
    if not (ours.complete and nothing.complete):
        return Status.NOT_MEASURED
    return settled(lead_over(ours, nothing, series.spec.metric.sign), above=True, bound=0.0)


CLAIMS: tuple[Claim, ...] = (
    *RECONSTRUCTION_CLAIMS,
    *FLOW_CLAIMS,
    *TRACKING_CLAIMS,
    ON_THE_SLIDER,
    *TRAINING_CLAIMS,
    BEATS_DOING_NOTHING,
)


def claims_of(config: Mapping[str, Any], scores: Scores) -> tuple[Claim, ...]:
    """Return the claims that a run is about.

    A run on a slider, real or virtual, is about claim 22 only. Other runs are about all claims if
    their sensors and lights are the paper's, else about training, which is our own question.
    """
    if "recorded" in config:
        return (ON_RECORDINGS,)
    scenes = scores.scenes()
    if scenes and {*scenes} <= {*PRINTS} and is_of_slider(config):
        return (ON_THE_SLIDER,)
    return CLAIMS if scores.asks_as_paper else TRAINING_CLAIMS


def judge_readings(
    config: Mapping[str, Any],
    readings: Mapping[str, Scores],
    scaling: Mapping[str, Scaling],
) -> dict[str, list[Verdict]]:
    """Judge the claims that a run is about with each photoreceptor, by its scores.

    Times between events, in `scaling` by scene, are of the first photoreceptor, so claims about
    them are not measured with others.
    """
    (first, shown), *others = readings.items()
    claims = claims_of(config, shown)
    verdicts = judge_all(shown, scaling, claims)
    statuses = {verdict.status for verdict in verdicts}
    if claims is TRAINING_CLAIMS and statuses == {Status.NOT_MEASURED}:
        claims, verdicts = (), []
    without = {scene: replace(numbers, intervals=()) for scene, numbers in scaling.items()}
    rest = {name: judge_all(scores, without, claims) for name, scores in others}
    return {first: verdicts, **rest}


def changed_verdicts(verdicts: Mapping[str, Sequence[Verdict]]) -> list[tuple[Verdict, ...]]:
    """Return the verdicts on each claim that differ between photoreceptors and are all measured."""
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
