"""Our own claim: which methods beat doing nothing, and in which light."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from tasks.registry import TASKS
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.verdict import Status, Verdict, settled
from tasks.study.results.asked import Condition, Series
from tasks.study.results.intervals import lead_over
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, base_speed
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
    others = {
        Status.DOES_NOT_HOLD: "worse",
        Status.UNDECIDED: "undecided",
        Status.NOT_MEASURED: "not measured",
    }
    rest = [f", {count[status]} {word}" for status, word in others.items() if count[status]]
    return f"{count[Status.HOLDS]} of {count.total()}{''.join(rest)}"


def _outcome(scores: Scores, series: Series, where: Condition) -> Status:
    ours, nothing = scores.cell(series, where), scores.baseline(series, where)
    if not (ours.complete and nothing.complete):
        return Status.NOT_MEASURED
    lead = lead_over(ours, nothing, TASKS[series.task].metric.sign)
    return settled(lead, above=True, bound=0.0)
