"""Show how long the run took, by stage and by method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tasks.evaluation.timings import JobTimings, MethodTimings
from tasks.registry import TASKS
from tasks.study.report.table import Table, Text
from tasks.study.results.asked import Series, sensor_of
from tasks.study.results.words import MISSING


def _stages(job: JobTimings) -> dict[str, tuple[float, dict[str, float]]]:
    """Return the time of each stage of a job, s, and its amounts of work by unit."""
    pixels_of_frame = job.resolution * (job.height or job.resolution)
    samples = 1e-6 * job.rendered_frames * pixels_of_frame * job.spp
    pixels, events = 1e-6 * job.pixel_frames, 1e-6 * job.events
    estimates = sum(method.estimates for method in job.methods)
    return {
        "rendering": (job.rendering_s, {"frames": job.rendered_frames, "M samples": samples}),
        "reading frames": (job.reading_s, {"frames": job.frames}),
        "simulating sensors": (job.simulating_s, {"M pixel-frames": pixels, "Mev": events}),
        "keeping events for the tasks": (job.collecting_s, {"Mev": events}),
        "estimating and scoring": (job.scoring_s, {"estimates": estimates}),
    }


def stage_table(costs: Sequence[JobTimings]) -> Table:
    """List time, share of the total and amounts of each stage; rates are medians over jobs."""
    jobs = [_stages(job) for job in costs]
    total_s = sum(took_s for job in jobs for took_s, _ in job.values())
    rows = {}
    for stage, (_, units) in jobs[0].items():
        took_s = [job[stage][0] for job in jobs]
        done = {unit: [job[stage][1][unit] for job in jobs] for unit in units}
        sums = [f"{_number(sum(amounts))} {unit}" for unit, amounts in done.items()]
        rates = [_rate(amounts, took_s, unit) for unit, amounts in done.items()]
        share = f"{100 * sum(took_s) / total_s:.0f}\u202f%" if total_s else MISSING
        time = _time(sum(took_s)) if any(took_s) else MISSING
        texts = time, share, "\n".join(sums), "\n".join(rates)
        rows[Text(stage)] = [Text(text) for text in texts]
    heads = [Text(head) for head in ("stage", "time", "share", "amount", "rate")]
    return Table("Stages, sum over jobs", heads, {Text(""): rows}, "stages")


def _rate(amounts: Sequence[float], seconds: Sequence[float], unit: str) -> str:
    rates = [n / s for n, s in zip(amounts, seconds, strict=True) if n and s > 0]
    return f"{_number(float(np.median(rates)))} {unit}/s" if rates else MISSING


def method_table(costs: Sequence[JobTimings]) -> Table:
    """List the time of an estimate by sensor, the number of estimates and their total time."""
    by_series: dict[Series, list[MethodTimings]] = {}
    for cost in (method for job in costs for method in job.methods):
        if cost.method != TASKS[cost.task].baseline:
            by_series.setdefault(Series(cost.task, cost.method, "", cost.variant), []).append(cost)
    sensors = sorted({sensor_of(cost) for every in by_series.values() for cost in every})
    rows = {
        Text(series.title): [
            *(_estimate([cost for cost in every if sensor_of(cost) == of]) for of in sensors),
            Text(f"{sum(cost.estimates for cost in every):,}"),
            Text(_time(sum(cost.cpu_s for cost in every))),
        ]
        for series, every in by_series.items()
    }
    heads = [Text(head) for head in ("method", *(of.label for of in sensors), "estimates", "total")]
    return Table("Time of an estimate, by sensor", heads, {Text(""): rows}, "costs")


def _estimate(costs: Sequence[MethodTimings]) -> Text:
    """Return the time of one estimate, and per million events of its input."""
    if not costs:
        return Text(MISSING)
    events = [cost.median_cpu_s * cost.estimates / cost.events for cost in costs if cost.events]
    each = f"{_time(1e6 * float(np.median(events)))} / Mev" if events else "no events"
    return Text(_time(float(np.median([cost.median_cpu_s for cost in costs]))), each)


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _time(seconds: float) -> str:
    """Format a time to three digits, in a suitable unit."""
    for factor, unit, below in ((1e6, "µs", 1e-3), (1e3, "ms", 1.0), (1.0, "s", 120.0)):
        if seconds < below:
            return f"{_number(seconds * factor)} {unit}"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
