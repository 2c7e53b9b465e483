"""Our own claim: every method beats doing nothing."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from tasks.registry import TASKS
from tasks.study.claims.claim import Claim, scope_text
from tasks.study.claims.verdict import Status, Verdict, settled
from tasks.study.results.asked import MetersPerSecond, sensor_of
from tasks.study.results.cells import Condition
from tasks.study.results.intervals import lead_over
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, base_speed
from tasks.study.results.words import cutoff_label, join_words, speed_label


@dataclass(frozen=True, kw_only=True)
class BaselineClaim(Claim):
    """Every method is better than its starting point in every cell."""

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Count the cells in which each method is better."""
        shown = [series for series in shown_series(scores) if series.is_method]
        by_series = {series: _outcomes(scores, series) for series in shown}
        counts = [scores.samples(s, scene) for s in shown for scene in scores.scenes(s)]
        scope = scope_text(samples=min(counts, default=None))
        outcomes = [outcome for of_series in by_series.values() for outcome in of_series.values()]
        ours = "\n".join(_text(*item) for item in by_series.items()) or "no rows of any method"
        return self.verdict(outcomes, ours, "not reported", scope)


BEATS_DOING_NOTHING = BaselineClaim(
    number=24,
    title="Every method beats doing nothing",
    statement="Under every condition the score is better than that of the image, flow or path that "
    "the method starts from.",
    note="Our own check: a score that does not beat its starting point says nothing about the "
    "resolution. The median difference of the samples decides. Ideal light counts once, at base "
    "speed: ideal pixels send the same events at every speed.",
)


_Outcomes = dict[Condition, Status]


def _outcomes(scores: Scores, series: Series) -> _Outcomes:
    base = base_speed(scores, series)
    return {
        where: _outcome(scores, series, where)
        for where in scores.conditions(series)
        if where.cutoff_hz != math.inf or where.speed == base
    }


def _outcome(scores: Scores, series: Series, where: Condition) -> Status:
    ours, nothing = scores.cell(series, where), scores.baseline(series, where)
    if not (ours.complete and nothing.complete):
        return Status.NOT_MEASURED
    lead = lead_over(ours, nothing, TASKS[series.task].metric.sign)
    return settled(lead, above=True, bound=0.0)


def _text(series: Series, outcomes: _Outcomes) -> str:
    """Say how often a method beats doing nothing, and where it does not."""
    count = Counter(outcomes.values())
    text = f"{series.title}: {count[Status.HOLDS]} of {len(outcomes)}"
    for status in (Status.UNDECIDED, Status.NOT_MEASURED):
        if count[status]:
            text += f", {count[status]} {status}"
    lost = [where for where, outcome in outcomes.items() if outcome is Status.DOES_NOT_HOLD]
    return f"{text}; not {_lost_text(lost, list(outcomes))}" if lost else text


def _lost_text(lost: list[Condition], every: list[Condition]) -> str:
    """Name each scene and cutoff, with widths and speeds unless all of them are meant."""
    parts = []
    for light in dict.fromkeys((c.scene, c.cutoff_hz) for c in lost):
        here = [c for c in every if (c.scene, c.cutoff_hz) == light]
        gone = [c for c in here if c in lost]
        in_m_s = any(isinstance(c.speed, MetersPerSecond) for c in here)  # flow at a factor too
        speeds_of: dict[str, list[str]] = {}
        for speed in sorted({c.speed for c in gone}):
            sensors = sorted(sensor_of(c) for c in gone if c.speed == speed)
            of_all = len(sensors) == len({sensor_of(c) for c in here})
            unit = "" if sensors[-1].name else " px"
            named = "all widths" if of_all else f"{join_words([*map(str, sensors)])}{unit}"
            label = speed_label("", speed).removeprefix("" if in_m_s else "speed ")
            speeds_of.setdefault(named, []).append(label)
        unit = "" if in_m_s else "speed "
        which = [f"{named} at {unit}{join_words(each)}" for named, each in speeds_of.items()]
        some = "" if len(gone) == len(here) else f" ({'; '.join(which)})"
        parts.append(f"{light[0]} {cutoff_label(light[1])}{some}")
    return "; ".join(parts)
