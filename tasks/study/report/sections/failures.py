"""Show from how far off pose tracking succeeds, and how often each method fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.plot import Line, Panel, Plot, Point, plot, width_keys
from tasks.study.report.table import Table, Text, cutoff_text, width_texts
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import TRACKING, ideal_success, judged_series, sigma_mm, sweep
from tasks.study.results.scores import Condition, Scores, base_speed
from tasks.study.results.words import MISSING, share_text


@dataclass(frozen=True, slots=True)
class Sweep:
    """One tracking method under all perturbations; `plot` is None for a single perturbation."""

    method: str
    plot: Plot | None
    tables: list[Table]


@dataclass(frozen=True, slots=True)
class Failures:
    """Data of the section. `able` lists the tasks in which a method can fail."""

    judged: str | None
    success: dict[str, float | None]
    sweeps: list[Sweep]
    reasons: Table | None
    able: list[str]


def failures(run: FinishedRun) -> Failures:
    """Collect perturbation sweeps and reasons of failures."""
    scores, judged = run.scores, judged_series(run.scores)
    methods = dict.fromkeys(one.method for one in scores.series() if one.task == TRACKING.task)
    able = [task for task, spec in TASKS.items() if spec.share_column is not None]
    return Failures(
        judged=judged and _sigma(judged),
        success={_sigma(s): ideal_success(scores, s) for s in sweep(scores, TRACKING.method)},
        sweeps=[_sweep(scores, found) for one in methods if (found := sweep(scores, one))],
        reasons=_reasons(scores, [one for one in scores.series() if one.task in able]),
        able=[TASKS[task].title for task in able],
    )


def _sigma(series: Series) -> str:
    return series.variant.removeprefix("sigma ")


def _sweep(scores: Scores, found: list[Series]) -> Sweep:
    name = found[0]._replace(variant="").name
    return Sweep(
        name,
        _plot(scores, found, name) if found[1:] else None,
        [_table(scores, found, scene) for scene in scores.scenes(found[0])],
    )


def _table(scores: Scores, found: list[Series], scene: str) -> Table:
    metric, widths = TASKS[found[0].task].metric, scores.widths(found[0])

    def text(series: Series, width: int, cutoff_hz: float) -> Text:
        where = Condition(scene, width, cutoff_hz, base_speed(scores, series))
        cell = scores.cell(series, where)
        if cell.median is None or cell.failure_share is None:
            return Text(MISSING)
        error = f"{metric.text(cell.median)} {metric.unit}"
        return Text(share_text(1 - cell.failure_share), error)

    blocks = {
        cutoff_text(hz): {
            Text(one.variant): [[text(one, width, hz)] for width in widths] for one in found
        }
        for hz in scores.cutoffs_hz(found[0])
    }
    caption = f"{scene}: share of successful trials, and median error of all trials"
    heads = [Text(""), *width_texts(widths)]
    return Table("sweep", f"Perturbations, {scene}", caption, heads, blocks)


def _plot(scores: Scores, found: list[Series], name: str) -> Plot:
    """Plot success against perturbation at base speed, over all scenes."""
    widths = scores.widths(found[0])
    panels = []
    for hz in scores.cutoffs_hz(found[0]):
        lines = []
        for width in widths:
            shares = {one: _pooled_success(scores, one, width, hz) for one in found}
            points = [
                Point(x, 100 * share, [f"{width} px", s.variant, f"{share_text(share)} succeed"])
                for s, share in shares.items()
                if share is not None and (x := sigma_mm(s.variant)) is not None
            ]
            lines.append(Line(points))
        panels.append(Panel(*cutoff_text(hz)[:2], lines))
    return plot(
        f"Success over the perturbation, {name}",
        "standard deviation of the perturbation [mm]",
        "successful trials [%]",
        width_keys(widths),
        panels,
        include_y=(0, 100),
    )


def _pooled_success(scores: Scores, series: Series, width: int, cutoff_hz: float) -> float | None:
    at = width, cutoff_hz, base_speed(scores, series)
    cells = [scores.cell(series, Condition(scene, *at)) for scene in scores.scenes(series)]
    failed = [cell.failed for cell in cells if cell.complete]
    return float(1 - np.concatenate(failed).mean()) if failed else None


def _reasons(scores: Scores, able: list[Series]) -> Table | None:
    rows = {}
    for one in able:
        total = sum(len(scores.cell(one, where).values) for where in scores.conditions(one))
        reasons = scores.failures(one)
        failed = reasons.total()
        why = ", ".join(f"{reason} ({count:,})" for reason, count in reasons.most_common(4))
        share = share_text(failed / total if total else None)
        texts = f"{failed:,} of {total:,}", share, why
        rows[Text(one.title)] = [[Text(text)] for text in texts]
    heads = [Text(head) for head in ("method", "failed", "share", "why")]
    return Table("failures", "Failures", "", heads, {Text(""): rows}) if rows else None
