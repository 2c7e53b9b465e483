"""What a claim's verdict says.

A claim holds when it holds on every scene of the run. The intervals tell how far the samples settle
it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from tasks.study.results.paper import CONTRAST_THRESHOLD
from tasks.study.results.scores import Scores


class Status(StrEnum):
    """What a run says about a claim."""

    HOLDS = "holds"
    DOES_NOT_HOLD = "does not hold"
    NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A claim of the paper, judged.

    Attributes
    ----------
    ours
        Our numbers, a line per scene, with 95 % intervals over the samples; or what is missing.
    paper
        The paper's numbers, a line per scene.
    note
        What was judged, and which reading of the paper where it contradicts itself.
    """

    number: int
    title: str
    statement: str
    status: Status
    ours: str
    paper: str
    note: str


def threshold_note(found: Sequence[Scores]) -> str:
    """Say at which contrast threshold claims are judged, the first of a run's; nothing where that
    is the paper's and the only one."""
    judged = found[0].contrast_threshold
    if judged == CONTRAST_THRESHOLD:
        if not found[1:]:
            return ""
        whose = ", that of the paper's sensors"
    else:
        whose = f"; the paper's sensors have {CONTRAST_THRESHOLD:g}"
    return f"Judged at a contrast threshold of {judged:g}{whose}."


def status_of(outcomes: Iterable[bool | None]) -> Status:
    """One contradiction settles it; what is not measured, or nothing at all, never holds."""
    found = set(outcomes)
    if False in found:
        return Status.DOES_NOT_HOLD
    return Status.HOLDS if found == {True} else Status.NOT_MEASURED
