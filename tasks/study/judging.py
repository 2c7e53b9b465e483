"""How a claim is judged: scene by scene, on medians over samples, with bootstrap intervals.

A claim holds when it holds on every scene of the run. The intervals tell how far the samples settle
it: percentile bootstrap over samples, paired over conditions (all cells of a scene are resampled
with the same sample indices).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from tasks.study.markup import join_words
from tasks.study.paper import BASE_SPEED_M_PER_S
from tasks.study.tables import Cell, Condition, Scores, Series, cutoff_label, number_text

MIN_SAMPLES_FOR_INTERVAL = 6
"""From 6 samples on, smallest and largest sample enclose the median with 95 % probability; with
fewer, no interval made of the samples can."""

EVENT_INTEGRATION = Series("reconstruction", "event_integration", "psnr_db")

_DRAWS = 2000


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


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number made of medians, with its 95 % interval; `low` and `high` are None where the
    samples are too few for one."""

    value: float
    low: float | None
    high: float | None

    def text(self, decimals: int = 2, sign: str = "+", unit: str = "") -> str:
        """Format as ``+3.18 [+2.90, +3.40] dB``."""

        def number(value: float) -> str:
            return number_text(value, decimals, sign)

        unit = f" {unit}" if unit else ""
        if self.low is None or self.high is None:
            return f"{number(self.value)}{unit}"
        return f"{number(self.value)} [{number(self.low)}, {number(self.high)}]{unit}"


def estimate(
    cells: Mapping[Condition, Cell],
    statistic: Statistic,
    of: Callable[[Cell], np.ndarray] = lambda cell: cell.values,
) -> Estimate:
    """Evaluate a statistic of medians, with a percentile bootstrap interval over samples.

    Parameters
    ----------
    cells
        Complete cells; those of one scene hold the same samples in the same order.
    statistic
        Takes the median of each cell, as an array of any shape, and returns that shape.
    of
        What to take the median of: the scores by default, or the event rates.

    Returns
    -------
    Estimate
        Seeded by the scene's name, so independent of order; without an interval if a cell has fewer
        than `MIN_SAMPLES_FOR_INTERVAL` samples.
    """
    value = float(statistic({where: np.median(of(cell)) for where, cell in cells.items()}))
    if min(len(cell.values) for cell in cells.values()) < MIN_SAMPLES_FOR_INTERVAL:
        return Estimate(value, None, None)
    draws = {
        where: np.median(of(cell)[_resampled_indices(where.scene, len(cell.values))], axis=1)
        for where, cell in cells.items()
    }
    low, high = np.percentile(statistic(draws), [2.5, 97.5])
    return Estimate(value, float(low), float(high))


def _resampled_indices(scene: str, samples: int) -> np.ndarray:
    rng = np.random.default_rng([zlib.crc32(scene.encode()), samples])
    return rng.integers(samples, size=(_DRAWS, samples))


Check = Callable[[str, Mapping[Condition, Cell]], tuple[bool | None, str]]


def judge_scenes(
    scores: Scores,
    conditions: Iterable[tuple[int, float, float]],
    check: Check,
    *,
    number: int,
    title: str,
    statement: str,
    paper: str,
    note: str,
    of_samples: bool = True,
) -> Verdict:
    """Judge scene by scene on event integration's rows.

    Parameters
    ----------
    conditions
        The (width, cutoff, speed) whose rows `check` needs.
    check
        Takes a scene and its cells; returns whether the claim holds there (None: cannot be told)
        and our numbers in words.
    of_samples
        Whether the numbers are medians over the samples, which can be too few for an interval.
    """
    needed = list(conditions)
    scenes = scores.scenes(EVENT_INTEGRATION)
    outcomes: dict[str, bool | None] = {}
    texts = []
    for scene in scenes:
        cells = {
            Condition(scene, *c): scores.cell(EVENT_INTEGRATION, Condition(scene, *c))
            for c in needed
        }
        missing = [where for where, cell in cells.items() if not cell.complete]
        if missing:
            outcomes[scene] = None
            texts.append(f"{scene}: not measured, {_missing_text(missing, cells)}")
        else:
            outcomes[scene], text = check(scene, cells)
            failed = " (does not hold)" if outcomes[scene] is False else ""
            texts.append(f"{scene}: {text}{failed}")
    if False in outcomes.values():
        status = Status.DOES_NOT_HOLD
    elif None in outcomes.values() or not outcomes:
        status = Status.NOT_MEASURED
    else:
        status = Status.HOLDS
    ours = "\n".join(texts) or "no rows of event integration"
    judged = [scene for scene in scenes if outcomes[scene] is not None]
    note = f"{note} {_scope_text(judged, scores, of_samples)}".strip()
    return Verdict(number, title, statement, status, ours, paper, note)


def _missing_text(missing: list[Condition], cells: Mapping[Condition, Cell]) -> str:
    def name(where: Condition) -> str:
        cell = cells[where]
        found = f" has {len(cell.values)} of {cell.expected} samples" if len(cell.values) else ""
        return f"{where.width} px, {cutoff_label(where.cutoff_hz)}, speed {where.speed:.2g}{found}"

    more = f" and {len(missing) - 2} more" if len(missing) > 2 else ""
    return f"missing {'; '.join(name(where) for where in missing[:2])}{more}"


def _scope_text(judged: list[str], scores: Scores, of_samples: bool) -> str:
    """Say what the verdict rests on, where that is less than the paper's."""
    if not judged:
        return ""
    unseen = [scene for scene in BASE_SPEED_M_PER_S if scene not in judged]
    parts = [f"on {join_words(judged)} only"] if unseen else []
    few = min(scores.samples(EVENT_INTEGRATION, scene) for scene in judged)
    if of_samples and few < MIN_SAMPLES_FOR_INTERVAL:
        plural = "sample" if few == 1 else "samples"
        parts.append(f"{few} {plural}, too few for an interval ({MIN_SAMPLES_FOR_INTERVAL} needed)")
    return f"Judged {'; '.join(parts)}." if parts else ""


def unsettled(estimated: Estimate, bound: float = 0.0) -> str:
    """Say it where the interval reaches to both sides of the bound that decides."""
    if estimated.low is None or estimated.high is None:
        return ""
    inside = estimated.low <= bound <= estimated.high
    return ", not settled by these samples" if inside else ""
