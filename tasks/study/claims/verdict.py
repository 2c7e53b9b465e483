"""The verdict on a claim.

A claim holds if it holds on every scene of the run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from tasks.study.results.paper import CONTRAST_THRESHOLD
from tasks.study.results.scores import Scores


class Status(StrEnum):
    """Whether a claim holds."""

    HOLDS = "holds"
    DOES_NOT_HOLD = "does not hold"
    NOT_MEASURED = "not measured"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A claim of the paper, judged.

    Attributes
    ----------
    ours
        Our numbers, a line for each scene, with 95 % intervals over samples; or what is missing.
    paper
        The paper's numbers, a line for each scene.
    note
        How the claim was read and judged.
    """

    number: int
    title: str
    statement: str
    status: Status
    ours: str
    paper: str
    note: str


def threshold_note(found: Sequence[Scores]) -> str:
    """Say at which contrast threshold the claims are judged.

    Parameters
    ----------
    found
        The scores of a run at each of its thresholds; the claims are judged at the first.

    Returns
    -------
    str
        "" if it is the paper's threshold and the only one.
    """
    judged = found[0].contrast_threshold
    if judged == CONTRAST_THRESHOLD:
        if not found[1:]:
            return ""
        whose = ", that of the paper's sensors"
    else:
        whose = f"; the paper's sensors have {CONTRAST_THRESHOLD:g}"
    return f"Judged at a contrast threshold of {judged:g}{whose}."


def status_of(outcomes: Iterable[bool | None]) -> Status:
    """Return HOLDS if all outcomes are True, DOES_NOT_HOLD if any is False."""
    found = set(outcomes)
    if False in found:
        return Status.DOES_NOT_HOLD
    return Status.HOLDS if found == {True} else Status.NOT_MEASURED
