"""Our own claim: every method beats doing nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tasks.study.claims.claim import Claim, too_few_text
from tasks.study.claims.verdict import Verdict
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL, estimate
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Condition, Scores, beats
from tasks.study.results.words import cutoff_label, join_words


@dataclass(frozen=True, kw_only=True)
class BaselineClaim(Claim):
    """Every method has a better median than its starting point in every cell."""

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Count the cells in which each method is better.

        Parameters
        ----------
        scores, scaling
            As `Claim.judge` takes them.

        Returns
        -------
        Verdict
            It follows from one outcome for each cell.
        """
        found = {series: _beaten(scores, series) for series in shown_series(scores)}
        counts = [scores.samples(one, scene) for one in found for scene in scores.scenes(one)]
        samples = min(counts, default=0)
        scope = "Not settled: the paired interval of the difference includes zero."
        if samples < MIN_SAMPLES_FOR_INTERVAL:
            scope = f"{too_few_text(samples)}."
        outcomes = [outcome for beaten in found.values() for outcome in beaten.values()]
        ours = "\n".join(_text(scores, *one) for one in found.items()) or "no rows of any method"
        return self.verdict(outcomes, ours, "not reported", scope)


BEATS_DOING_NOTHING = BaselineClaim(
    number=24,
    title="Every method beats doing nothing",
    statement="Under every condition the median score is better than that of the image, flow or "
    "path that the method starts from.",
    note="Our own check: a score that does not beat its starting point says nothing about the "
    "resolution.",
)


_Beaten = dict[Condition, bool | None]  # None where a score is missing


def _beaten(scores: Scores, series: Series) -> _Beaten:
    return {
        where: beats(scores.cell(series, where), scores.baseline(series, where), series)
        for where in scores.conditions(series)
    }


def _text(scores: Scores, series: Series, beaten: _Beaten) -> str:
    """Say how often a method beats doing nothing, and where it does not."""
    measured = [where for where, outcome in beaten.items() if outcome is not None]
    lost = [where for where in measured if not beaten[where]]
    text = f"{series.title}: {len(measured) - len(lost)} of {len(measured)}"
    if unsettled := sum(_unsettled(scores, series, where) for where in measured):
        text += f" ({unsettled} not settled)"
    if unknown := len(beaten) - len(measured):
        text += f", {unknown} not measured"
    return f"{text}; not {_lost_text(lost, list(beaten))}" if lost else text


def _unsettled(scores: Scores, series: Series, where: Condition) -> bool:
    cells = {"ours": scores.cell(series, where), "nothing": scores.baseline(series, where)}
    return estimate(cells, lambda medians: medians["ours"] - medians["nothing"]).includes(0.0)


def _lost_text(lost: list[Condition], every: list[Condition]) -> str:
    """Name each scene and cutoff, with widths and speeds unless all of them are meant."""
    parts = []
    for light in dict.fromkeys((c.scene, c.cutoff_hz) for c in lost):
        here = [c for c in every if (c.scene, c.cutoff_hz) == light]
        gone = [c for c in here if c in lost]
        speeds_of: dict[str, list[str]] = {}
        for speed in sorted({c.speed for c in gone}):
            widths = sorted(c.width for c in gone if c.speed == speed)
            of_all = len(widths) == len({c.width for c in here})
            named = "all widths" if of_all else f"{join_words([str(w) for w in widths])} px"
            speeds_of.setdefault(named, []).append(f"{speed:.2g}")
        which = [f"{named} at speed {join_words(speeds)}" for named, speeds in speeds_of.items()]
        some = "" if len(gone) == len(here) else f" ({'; '.join(which)})"
        parts.append(f"{light[0]} {cutoff_label(light[1])}{some}")
    return "; ".join(parts)
