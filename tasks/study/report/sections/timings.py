"""Show how long the run took, by stage and by method."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tasks.evaluation.timings import JobTimings, MethodTimings
from tasks.registry import TASKS
from tasks.study.report.table import Table, Text
from tasks.study.results.asked import sensor_of
from tasks.study.results.metrics import Series
from tasks.study.results.words import MISSING


def _stages(one: JobTimings) -> dict[str, tuple[float, dict[str, float]]]:
    """Return the time of each stage of a job, s, and its amounts of work by unit."""
    pixels_of_frame = one.resolution * (one.height or one.resolution)
    samples = 1e-6 * one.rendered_frames * pixels_of_frame * one.spp
    pixels, events = 1e-6 * one.pixel_frames, 1e-6 * one.events
    estimates = sum(method.estimates for method in one.methods)
    return {
        "rendering": (one.rendering_s, {"frames": one.rendered_frames, "M samples": samples}),
        "reading frames": (one.reading_s, {"frames": one.frames}),
        "simulating sensors": (one.simulating_s, {"M pixel-frames": pixels, "Mev": events}),
        "keeping events for the tasks": (one.collecting_s, {"Mev": events}),
        "estimating and scoring": (one.scoring_s, {"estimates": estimates}),
    }


def stage_table(costs: Sequence[JobTimings]) -> Table:
    """List time, share of the total and amounts of each stage; rates are medians over jobs."""
    jobs = [_stages(one) for one in costs]
    total_s = sum(took_s for job in jobs for took_s, _ in job.values())
    rows = {}
    for stage, (_, units) in jobs[0].items():
        took_s = [job[stage][0] for job in jobs]
        done = {unit: [job[stage][1][unit] for job in jobs] for unit in units}
        sums = [f"{_number(sum(found))} {unit}" for unit, found in done.items()]
        rates = [_rate(found, took_s, unit) for unit, found in done.items()]
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
    found: dict[Series, list[MethodTimings]] = {}
    for cost in (method for one in costs for method in one.methods):
        if cost.method != TASKS[cost.task].baseline:
            found.setdefault(Series(cost.task, cost.method, "", cost.variant), []).append(cost)
    sensors = sorted({sensor_of(one) for every in found.values() for one in every})
    rows = {
        Text(series.title): [
            *(_estimate([one for one in every if sensor_of(one) == of]) for of in sensors),
            Text(f"{sum(one.estimates for one in every):,}"),
            Text(_time(sum(one.cpu_s for one in every))),
        ]
        for series, every in found.items()
    }
    heads = [Text(head) for head in ("method", *(of.label for of in sensors), "estimates", "total")]
    return Table("Time of an estimate, by sensor", heads, {Text(""): rows}, "costs")


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
