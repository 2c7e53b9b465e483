"""Show how long the run took, by stage and by method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tasks.evaluation.timings import JobTimings, MethodTimings, read_timings
from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.table import Rows, Table, Text, width_texts
from tasks.study.results.metrics import Series
from tasks.study.results.words import MISSING, join_words


@dataclass(frozen=True, slots=True)
class Timings:
    """Times of all jobs of a run, and their numbers of cores."""

    jobs: int
    cores: str
    stages: Table
    methods: Table


def timings(run: FinishedRun) -> Timings:
    """Read and sum up the times of all jobs."""
    return summarize(read_timings(run.folder / "costs"))


def summarize(costs: Sequence[JobTimings]) -> Timings:
    """Sum up the times of jobs; rates are medians over jobs."""
    heads = [Text(head) for head in ("stage", "time", "share", "amount", "rate")]
    stages = {Text(""): _stages(costs) if costs else {}}
    return Timings(
        jobs=len(costs),
        cores=join_words([str(n) for n in sorted({one.cores for one in costs})] or [MISSING], "or"),
        stages=Table("stages", "Time of each stage", "Stages, sum over jobs", heads, stages),
        methods=_methods(costs),
    )


def _stages(costs: Sequence[JobTimings]) -> Rows:
    """Return time, share of the total, amounts and rates of each stage."""

    def of_jobs(amount: Callable[[JobTimings], float]) -> list[float]:
        return [amount(one) for one in costs]

    frames = of_jobs(lambda one: one.rendered_frames)
    samples = of_jobs(lambda one: 1e-6 * one.rendered_frames * one.resolution**2 * one.spp)
    read = of_jobs(lambda one: one.frames)
    pixels = of_jobs(lambda one: 1e-6 * one.pixel_frames)
    events = of_jobs(lambda one: 1e-6 * one.events)
    estimates = of_jobs(lambda one: sum(method.estimates for method in one.methods))
    stages = {
        "rendering": ("rendering_s", {"frames": frames, "M samples": samples}),
        "reading frames": ("reading_s", {"frames": read}),
        "simulating sensors": ("simulating_s", {"M pixel-frames": pixels, "Mev": events}),
        "keeping events for the tasks": ("collecting_s", {"Mev": events}),
        "estimating and scoring": ("scoring_s", {"estimates": estimates}),
    }
    total_s = sum(getattr(one, field) for field, _ in stages.values() for one in costs)
    rows = {}
    for stage, (field, done) in stages.items():
        took_s = [getattr(one, field) for one in costs]
        amounts = [f"{_number(sum(found))} {unit}" for unit, found in done.items()]
        rates = [_rate(found, took_s, unit) for unit, found in done.items()]
        share = f"{100 * sum(took_s) / total_s:.0f}\u202f%" if total_s else MISSING
        time = _time(sum(took_s)) if any(took_s) else MISSING
        texts = time, share, "\n".join(amounts), "\n".join(rates)
        rows[Text(stage)] = [[Text(text)] for text in texts]
    return rows


def _rate(amounts: Sequence[float], seconds: Sequence[float], unit: str) -> str:
    rates = [n / s for n, s in zip(amounts, seconds, strict=True) if n and s > 0]
    return f"{_number(float(np.median(rates)))} {unit}/s" if rates else MISSING


def _methods(costs: Sequence[JobTimings]) -> Table:
    found: dict[Series, list[MethodTimings]] = {}
    for cost in (method for one in costs for method in one.methods):
        if cost.method != TASKS[cost.task].baseline:
            found.setdefault(Series(cost.task, cost.method, "", cost.variant), []).append(cost)
    widths = sorted({one.width for every in found.values() for one in every})
    rows = {
        Text(series.title): [
            *([_estimate([one for one in every if one.width == width])] for width in widths),
            [Text(f"{sum(one.estimates for one in every):,}")],
            [Text(_time(sum(one.cpu_s for one in every)))],
        ]
        for series, every in found.items()
    }
    heads = [Text("method"), *width_texts(widths), Text("estimates"), Text("total")]
    caption = "Time of an estimate, by sensor"
    return Table("costs", "Time of each method", caption, heads, {Text(""): rows})


def _estimate(costs: Sequence[MethodTimings]) -> Text:
    """Return the time of one estimate, and per million events of its input."""
    if not costs:
        return Text(MISSING)
    events = [one.median_cpu_s * one.estimates / one.events for one in costs if one.events]
    each = f"{_time(1e6 * float(np.median(events)))} / Mev" if events else "no events"
    return Text(_time(float(np.median([one.median_cpu_s for one in costs]))), each)


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _time(seconds: float) -> str:
    """Format a time to three digits, in a suitable unit."""
    for factor, unit, below in ((1e6, "µs", 1e-3), (1e3, "ms", 1.0), (1.0, "s", 120.0)):
        if seconds < below:
            return f"{_number(seconds * factor)} {unit}"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
