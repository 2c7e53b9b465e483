"""The answer of a study: which sensor is enough for each task, light and speed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.table import Text, cutoff_text
from tasks.study.results.choice import Choice, choose
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import is_main
from tasks.study.results.words import (
    MISSING,
    capitalized,
    cutoff_label,
    join_words,
    rate_label,
    speed_label,
)


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer for a task in one light at one speed.

    Attributes
    ----------
    where
        Light and speed in words.
    width, facts
        The width that is enough, or a dash; its event rate and the share of the bus.
    kind
        "", "struck" (doing nothing is as good) or "over" (more events than the bus carries).
    tied
        Smaller width that the samples do not separate from the best, px; None if there is none.
    fineness
        Rank of the width among those of the study, 0 (coarsest) to 100 (finest).
    on_buses
        JSON list of [capacity in Mev/s, width in px or null, Mev/s], as in `Choice.on_buses`.
    """

    where: str
    width: str
    facts: str
    kind: str
    tied: int | None
    fineness: int
    on_buses: str


@dataclass(frozen=True, slots=True)
class Block:
    """Answers on one scene: a speed for each column of a light, a row for each task."""

    speeds: Sequence[str]
    rows: Mapping[Text, Sequence[Answer]]


@dataclass(frozen=True, slots=True)
class Matrix:
    """All answers: lights as groups of columns, scenes as blocks of rows.

    `near` are the differences that do not matter, in the units of the metrics.
    """

    near: str
    widths: Sequence[int]
    lights: Sequence[Text]
    blocks: Mapping[str, Block]


def matrix(run: FinishedRun) -> Matrix:
    """Return the answers of a run: the main methods at the speeds that all of them have."""
    scores = run.scores
    series = [one for one in run.series if is_main(one)] or run.firsts
    cutoffs_hz = sorted({hz for one in series for hz in scores.cutoffs_hz(one)}, reverse=True)
    widths = sorted({width for one in series for width in scores.widths(one)})
    every = [{*scores.speeds(one, scene)} for one in series for scene in scores.scenes(one)]
    speeds = sorted(set.intersection(*every)) or sorted(set.union(*every))[:1]
    blocks = {}
    for scene in run.scenes:
        rows = {
            Text(capitalized(TASKS[one.task].title), TASKS[one.task].label(one.method)): [
                _answer(run, one, (scene, hz, speed), widths)
                for hz in cutoffs_hz
                for speed in speeds
            ]
            for one in series
            if scene in scores.scenes(one)
        }
        blocks[scene] = Block([speed_label(scene, one, run.base_speeds) for one in speeds], rows)
    metrics = dict.fromkeys(TASKS[one.task].metric for one in series)
    near = join_words([f"{metric.negligible:g} {metric.unit}" for metric in metrics], "or")
    return Matrix(near, widths, [*map(cutoff_text, cutoffs_hz)], blocks)


def _answer(
    run: FinishedRun, series: Series, at: tuple[str, float, float], widths: Sequence[int]
) -> Answer:
    scene, cutoff_hz, speed = at
    where = f"{cutoff_label(cutoff_hz)}, {speed_label(scene, speed, run.base_speeds)}"
    choice = choose(run.scores, series, *at)
    if choice is None:
        return Answer(where, MISSING, "samples are missing", "", None, 0, "[]")
    rate_hz = choice.event_rates_hz[choice.enough]
    share = rate_hz / run.bus_hz
    return Answer(
        where=where,
        width=str(choice.enough),
        facts=f"{rate_label(rate_hz)} · {'<1' if share < 0.01 else round(100 * share)}\u202f%",
        kind="struck" if not choice.worthwhile else "over" if share > 1 else "",
        tied=choice.tied if choice.worthwhile else None,
        fineness=round(100 * widths.index(choice.enough) / max(len(widths) - 1, 1)),
        on_buses=_on_buses(choice),
    )


def _on_buses(choice: Choice) -> str:
    rates_hz = choice.event_rates_hz
    found = [
        (bus.capacity_hz / 1e6, bus.enough, bus.enough and rates_hz[bus.enough] / 1e6)
        for bus in choice.on_buses
    ]
    return json.dumps(found)
