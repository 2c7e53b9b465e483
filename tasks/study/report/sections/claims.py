"""The paper's claims, and what this run says of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tasks.study.claims.verdict import Status, Verdict, threshold_note
from tasks.study.report.finished_run import FinishedRun


@dataclass(frozen=True, slots=True)
class Claims:
    """The verdicts, how many of each status, and at which contrast threshold."""

    verdicts: Sequence[Verdict]
    tally: Mapping[str, int]
    threshold_note: str


def claims(run: FinishedRun) -> Claims:
    """Collect the section."""
    found = [one.status for one in run.verdicts]
    tally = {status.value: found.count(status) for status in Status}
    return Claims(run.verdicts, tally, threshold_note(run.found))
