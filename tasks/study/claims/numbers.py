"""The numbers of a claim: each is read from the scores on one scene, printed and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from tasks.metric import Metric
from tasks.study.claims.statistics import Extreme, SceneCell, Statistic, lead
from tasks.study.claims.verdict import Status, holm, settled
from tasks.study.results.asked import Condition, Series
from tasks.study.results.cells import Cell
from tasks.study.results.intervals import TAILS, Interval, estimate
from tasks.study.results.paper import WIDTHS
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, paper_scores
from tasks.study.results.words import cutoff_label


class NotMeasured(Exception):
    """These scores do not give a number; the text says why."""


@dataclass(frozen=True, slots=True)
class SceneScores:
    """Scores of one method on one scene, ours or the paper's."""

    scores: Scores
    series: Series
    scene: str
    scaling: Scaling | None = None

    @property
    def metric(self) -> Metric:
        """Metric of the scores."""
        return self.series.spec.metric

    def cell(self, where: SceneCell) -> Cell:
        """Return one cell; it has no values if it was not measured."""
        return self.scores.cell(self._series_of(where), Condition(self.scene, *where[:3]))

    def _series_of(self, where: SceneCell) -> Series:
        task, method = where.task or self.series.task, where.method or self.series.method
        return self.series._replace(task=task, method=method)

    def median(self, where: SceneCell) -> float:
        """Return the median score of one cell."""
        self.require([where])
        return float(np.median(self.cell(where).values))

    def best_width(self, cutoff_hz: float, speed: float) -> int:
        """Return the width with the best median, px."""
        sign = self.metric.sign
        return max(WIDTHS, key=lambda w: sign * self.median(SceneCell(w, cutoff_hz, speed)))

    def require(self, needed: Iterable[SceneCell]) -> None:
        """Check that cells are complete."""
        missing = [where for where in needed if not self.cell(where).complete]
        if not missing:
            return
        method = missing[0].method  # cells of the claim's own method come first
        missing = [where for where in missing if where.method == method]
        more = f" and {len(missing) - 2} more" if len(missing) > 2 else ""
        of_method = f" of {self._series_of(missing[0]).name}" if method else ""
        named = "; ".join(self._missing_text(where) for where in missing[:2])
        raise NotMeasured(f"not measured, missing {named}{more}{of_method}")

    def _missing_text(self, where: SceneCell) -> str:
        cell = self.cell(where)
        per_sample = "values" if len(cell.values) > cell.samples else "samples"
        count = f" has {len(cell.values)} of {cell.expected} {per_sample}" * (len(cell.values) > 0)
        return f"{where.width} px, {cutoff_label(where.cutoff_hz)}, speed {where.speed:.2g}{count}"


def estimated(statistic: Statistic, *scenes: SceneScores, tail: float = TAILS[0]) -> Interval:
    """Evaluate a statistic of a scene's medians, with an interval with two such tails."""
    for on in scenes:
        on.require(statistic.cells)
    rates = statistic.of_rates
    cells = [
        {at: on.cell(at).rates if rates else on.cell(at) for at in statistic.cells} for on in scenes
    ]
    values = np.concatenate([cell.values for of_scene in cells for cell in of_scene.values()])
    if np.isnan(values).any():
        raise NotMeasured("not measured, there are no event rates")
    if statistic.positive and not np.all(values > 0):
        zero = "a sample has no events" if rates else "an error is 0"
        raise NotMeasured(f"not measured, {zero}")
    sign = 1.0 if rates else scenes[0].metric.sign
    return _of_parts(statistic, cells, sign, (tail, tail))


def _of_parts(
    statistic: Statistic,
    scenes: Sequence[Mapping[SceneCell, Cell]],
    sign: float,
    tails: tuple[float, float],
) -> Interval:
    """Return an estimate; the estimate of an extreme follows from its parts.

    Each bound of an interval may be on the wrong side of the truth with the probability of its
    tail. The smallest lower bound is above the smallest number only if the bound of that number is.
    The smallest upper bound is below it if any upper bound is, so the parts share this tail
    (Bonferroni). For the largest number the bounds change places.
    """
    if statistic.extreme is None:
        return estimate(statistic.of, *scenes, sign=sign, tails=tails)
    low, high = tails
    if statistic.extreme is Extreme.SMALLEST:
        pick, tails = min, (low, high / len(statistic.parts))
    else:
        pick, tails = max, (low / len(statistic.parts), high)
    parts = [_of_parts(part, scenes, sign, tails) for part in statistic.parts]
    extreme = pick(parts, key=lambda part: part.value)
    lows = [part.low for part in parts if part.low is not None]
    highs = [part.high for part in parts if part.high is not None]
    if not lows:  # too few samples, in all parts
        return extreme
    return replace(extreme, low=pick(lows), high=pick(highs))


class NumberText(NamedTuple):
    """A number as text, whether it is as the claim says, and whether it is like the paper's."""

    text: str
    status: Status = Status.HOLDS
    like_paper: bool | None = None  # None if there is nothing to compare
    fails_at: Callable[[float], bool] | None = None
    """Whether its interval with such tails contradicts the claim; None if it has none to do so."""
    intervals: int = 0
    """Of a scene: the number of its intervals that could."""


def corrected(numbers: Sequence[NumberText]) -> list[NumberText]:
    """Return the numbers of a claim, of which those fail that do so after Holm's correction."""
    tests = {k: number.fails_at for k, number in enumerate(numbers) if number.fails_at}
    doubtful = {k for k in tests if numbers[k].status is Status.DOES_NOT_HOLD}
    doubtful -= holm(tests, TAILS[0])
    doubt = f", not settled as one of {len(tests)}"
    return [
        number._replace(text=number.text + doubt, status=Status.UNDECIDED)
        if k in doubtful
        else number
        for k, number in enumerate(numbers)
    ]


class Quantity(Protocol):
    """A function that reads a number on one scene."""

    def __call__(self, on: SceneScores, /) -> NumberText: ...


@dataclass(frozen=True, slots=True)
class Number:
    """A statistic with its interval, and the bound that the claim sets on it.

    Attributes
    ----------
    statistic
        The statistic of medians.
    above, below
        The claim holds if the statistic lies above or below this bound. Give one of them, or none.
    below_on
        Scenes where the statistic must lie below the bound `above`.
    in_words
        The paper's number, if it is in the paper's text and not in its tables.
    unit
        Unit to print; None for that of the metric.
    decimals, sign
        Format of the number; "+" prints a plus sign.
    """

    statistic: Statistic
    _: KW_ONLY
    above: float | None = None
    below: float | None = None
    below_on: tuple[str, ...] = ()
    in_words: float | None = None
    unit: str | None = None
    decimals: int = 2
    sign: str = "+"

    def __call__(self, on: SceneScores) -> NumberText:
        ours = estimated(self.statistic, on)
        text = self.text_of(ours, on.metric)
        bound = self.below if self.above is None else self.above
        if bound is None:
            return NumberText(text)
        above = self.above is not None and on.scene not in self.below_on
        holds, fails = Status.HOLDS, Status.DOES_NOT_HOLD
        if on.scores is paper_scores():  # whose spread is unknown: the values decide
            return NumberText(text, holds if (ours.value > bound) == above else fails)
        if ours.low is not None and not ours.settles(bound):
            tied = ours.low == ours.high == bound  # as where all searches keep their starts
            text += ", tied in these samples" if tied else ", not settled by these samples"
        judged = partial(settled, above=above, bound=bound)
        status = judged(ours)

        def fails_at(tail: float) -> bool:
            return status is fails and judged(estimated(self.statistic, on, tail=tail)) is fails

        able = None if ours.low is None else fails_at
        return NumberText(text, status, self._like_paper(ours, on), able)

    def text_of(self, interval: Interval, metric: Metric) -> str:
        """Format the number with its interval.

        Parameters
        ----------
        interval
            The number with its interval.
        metric
            Its unit is printed if the number has none of its own.

        Returns
        -------
        str
            Value, interval and unit.
        """
        unit = metric.unit if self.unit is None else self.unit
        return interval.text(self.decimals, self.sign, unit)

    def _like_paper(self, ours: Interval, on: SceneScores) -> bool | None:
        """Return whether the paper's number is within our interval."""
        paper = replace(on, scores=paper_scores(), series=on.series._replace(variant=""))
        at_its_threshold = on.scores.contrast_threshold == paper.scores.contrast_threshold
        if ours.low is None or not at_its_threshold:
            return None
        if self.in_words is not None:
            return ours.includes(self.in_words)
        with suppress(NotMeasured):
            return ours.includes(estimated(self.statistic, paper).value)
        return None


class MedianOf(SceneCell):
    """The median of one cell."""

    def __call__(self, on: SceneScores) -> NumberText:
        return NumberText(f"{on.metric.text(on.median(self))} {on.metric.unit}")


class Best(NamedTuple):
    """The best median, and the width that has it."""

    cutoff_hz: float
    speed: float = 1.0

    def __call__(self, on: SceneScores) -> NumberText:
        width = on.best_width(*self)
        return NumberText(f"{MedianOf(width, *self)(on).text} at {width} px")


def best_and_lead(
    widths: Sequence[int], cutoff_hz: float, best: str = "best", ahead: str = "lead"
) -> dict[str, Quantity]:
    """Return the numbers of a claim that a width is the best of some in a light, at base speed."""
    return {best: Best(cutoff_hz), ahead: Number(lead(widths, cutoff_hz), above=0)}
