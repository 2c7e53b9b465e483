"""The verdict on a claim: whether it holds, and whether our numbers are like the paper's.

A claim holds if it holds on every scene of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from tasks.study.results.intervals import Interval
from tasks.study.results.paper import CONTRAST_THRESHOLD
from tasks.study.results.scores import Scores


class Status(StrEnum):
    """Whether a claim holds. A table of many conditions has no single verdict."""

    HOLDS = "holds"
    DOES_NOT_HOLD = "does not hold"
    UNDECIDED = "undecided"
    NOT_MEASURED = "not measured"
    NO_VERDICT = "no single verdict"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A claim of the paper, judged.

    `ours` and `paper` have a line for each scene, ours with 95 % intervals, or say what is missing.
    `likeness` says on how many scenes our numbers are like the paper's. `intervals` is the number
    of intervals that could have contradicted the claim.
    """

    number: int
    title: str
    statement: str
    status: Status
    ours: str
    paper: str
    note: str
    likeness: str = ""
    intervals: int = 0
    why: str = ""


def threshold_note(scores: Sequence[Scores]) -> str:
    """Say at which contrast threshold the claims are judged; "" if only at the paper's.

    `scores` are of a run at each of its thresholds; the claims are judged at the first.
    """
    judged = scores[0].contrast_threshold
    if judged == CONTRAST_THRESHOLD and not scores[1:]:
        return ""
    whose = ", that of the paper's sensors"
    if judged != CONTRAST_THRESHOLD:
        whose = f"; the paper's sensors have {CONTRAST_THRESHOLD:g}"
    return f"Judged at a contrast threshold of {judged:g}{whose}."


def chance_note(verdicts: Iterable[Verdict]) -> str:
    """Say how many intervals of some verdicts miss by chance, and what is done about it."""
    count = sum(verdict.intervals for verdict in verdicts)
    if not count:
        return ""
    return (
        f"{count} intervals decide these claims; {0.05 * count:.1f} of so many miss the truth by "
        "chance. So where an interval contradicts a claim, the claim does not hold only if the "
        "interval still does after Holm's correction for all intervals of the claim."
    )


def settled(estimate: Interval, *, above: bool, bound: float) -> Status:
    """Judge a claim that a number lies above a bound, or without `above`, below it."""
    if not estimate.settles(bound):
        return Status.UNDECIDED
    return Status.HOLDS if (estimate.value > bound) == above else Status.DOES_NOT_HOLD


def holm(tests: Mapping[int, Callable[[float], bool]], level: float) -> set[int]:
    """Return which tests reject at a level that all share, by Holm's method.

    A test that rejects at a level also rejects at each higher level.
    """
    rejected: set[int] = set()
    while more := {
        key
        for key, rejects in tests.items()
        if key not in rejected and rejects(level / (len(tests) - len(rejected)))
    }:
        rejected |= more
    return rejected


def status_of(outcomes: Iterable[Status]) -> Status:
    """Combine outcomes of which all must hold, as on scenes, in cells or of numbers."""
    by_weight = (Status.DOES_NOT_HOLD, Status.NOT_MEASURED, Status.UNDECIDED, Status.HOLDS)
    return _first((*by_weight, Status.NO_VERDICT), outcomes)


def status_of_any(outcomes: Iterable[Status]) -> Status:
    """Combine outcomes of which one must hold, as in lights of which one is the paper's."""
    by_weight = (Status.HOLDS, Status.NOT_MEASURED, Status.UNDECIDED, Status.DOES_NOT_HOLD)
    return _first(by_weight, outcomes)


def _first(by_weight: Iterable[Status], outcomes: Iterable[Status]) -> Status:
    statuses = set(outcomes)
    return next((status for status in by_weight if status in statuses), Status.NOT_MEASURED)
