"""How a claim is judged: scene by scene, on medians over samples, with bootstrap intervals.

A claim holds when it holds on every scene of the run. The intervals tell how far the samples settle
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL, Estimate
from tasks.study.results.metrics import Series
from tasks.study.results.paper import BASE_SPEED_M_PER_S, CONTRAST_THRESHOLD, WIDTHS, published
from tasks.study.results.scores import Cell, Condition, Scores
from tasks.study.results.words import cutoff_label, join_words

EVENT_INTEGRATION = Series("reconstruction", "event_integration", "psnr_db")


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
        One sentence: what was judged, and which reading of the paper where it contradicts itself.
    """

    number: int
    title: str
    statement: str
    status: Status
    ours: str
    paper: str
    note: str


Medians = Mapping[Condition, np.ndarray]  # each () from the samples, or (draws,) from resamples


Statistic = Callable[[Medians], np.ndarray]


Check = Callable[[str, Mapping[Condition, Cell]], tuple[bool | None, str]]


def judge_scenes(
    scores: Scores,
    series: Series,
    conditions: Iterable[tuple[int, float, float]],
    check: Check,
    *,
    number: int,
    title: str,
    statement: str,
    paper: str,
    note: str,
    scenes: Sequence[str] = (),
    of_samples: bool = True,
) -> Verdict:
    """Judge scene by scene on the rows of one series.

    Parameters
    ----------
    series
        Whose rows.
    conditions
        The (width, cutoff, speed) whose rows `check` needs.
    check
        Takes a scene and its cells; returns whether the claim holds there (None: cannot be told)
        and our numbers in words.
    scenes
        The scenes that the claim is about; all of the run if empty.
    of_samples
        Whether the numbers are medians over the samples, which can be too few for an interval.
    """
    needed = list(conditions)
    run = [scene for scene in scores.scenes(series) if not scenes or scene in scenes]
    outcomes: dict[str, bool | None] = {}
    texts = []
    for scene in run:
        cells = {
            where: scores.cell(series, where) for where in (Condition(scene, *c) for c in needed)
        }
        if missing := missing_text(cells):
            outcomes[scene], text = None, missing
        else:
            outcomes[scene], text = check(scene, cells)
        judged_text, *asides = text.split("\n")
        failed = " (does not hold)" if outcomes[scene] is False else ""
        texts += [f"{scene}: {judged_text}{failed}", *asides]
    where = f" on {join_words(scenes, 'or')}" if scenes else ""
    ours = "\n".join(texts) or f"no rows of {series.name}{where}"
    judged = [scene for scene in run if outcomes[scene] is not None]
    claimed = scenes or [scene for scene in BASE_SPEED_M_PER_S if _in_paper(scene, series)]
    scope = _scope_text(scores, series, judged, claimed, of_samples)
    note = f"{note} {scope}".strip()
    return Verdict(number, title, statement, status_of(outcomes.values()), ours, paper, note)


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


def missing_text(cells: Mapping[Condition, Cell]) -> str:
    """Name the cells that are not complete; nothing where all are."""
    missing = [where for where, cell in cells.items() if not cell.complete]
    if not missing:
        return ""

    def name(where: Condition) -> str:
        cell = cells[where]
        per_sample = "values" if len(cell.values) > cell.samples else "samples"
        count = f" has {len(cell.values)} of {cell.expected} {per_sample}"
        found = count if len(cell.values) else ""
        return f"{where.width} px, {cutoff_label(where.cutoff_hz)}, speed {where.speed:.2g}{found}"

    more = f" and {len(missing) - 2} more" if len(missing) > 2 else ""
    return f"not measured, missing {'; '.join(name(where) for where in missing[:2])}{more}"


def _in_paper(scene: str, series: Series) -> bool:
    return any(
        published(scene, series.task, series.method, width, math.inf, 1.0, series.metric)
        for width in WIDTHS
    )


def _scope_text(
    scores: Scores,
    series: Series,
    judged: Sequence[str],
    claimed: Sequence[str],
    of_samples: bool,
) -> str:
    """Say what the verdict rests on, where that is less than the paper's."""
    if not judged:
        return ""
    unseen = [scene for scene in claimed if scene not in judged]
    parts = [f"Judged on {join_words(judged)} only"] if unseen else []
    few = min(scores.samples(series, scene) for scene in judged)
    if of_samples and few < MIN_SAMPLES_FOR_INTERVAL:
        plural = "sample" if few == 1 else "samples"
        parts.append(f"{few} {plural}, too few for an interval ({MIN_SAMPLES_FOR_INTERVAL} needed)")
    return f"{'; '.join(parts)}." if parts else ""


def unsettled(estimated: Estimate, bound: float = 0.0) -> str:
    """Say it where the interval reaches to both sides of the bound that decides."""
    if estimated.low is None or estimated.high is None:
        return ""
    inside = estimated.low <= bound <= estimated.high
    return ", not settled by these samples" if inside else ""
