"""What the run took: stage by stage, and method by method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from tasks.evaluation.registry import TASKS
from tasks.evaluation.timings import MethodCost, PartCosts, read_costs
from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.metrics import Series
from tasks.study.results.words import MISSING, join_words


@dataclass(frozen=True, slots=True)
class StageTime:
    """One stage of all parts: its share of the time, what was done in it, and how fast."""

    name: str
    seconds: float
    share: float | None
    done: list[str]
    rates: list[str]


@dataclass(frozen=True, slots=True)
class MethodTime:
    """One method: by sensor width, the seconds of an estimate and of a million events."""

    title: str
    by_width: dict[int, tuple[float, float | None]]
    estimates: int
    cpu_s: float


@dataclass(frozen=True, slots=True)
class Timings:
    """What all parts of a run took."""

    parts: int
    cores: str
    stages: list[StageTime]
    methods: list[MethodTime]
    widths: list[int]


def timings(run: FinishedRun) -> Timings:
    """Collect the section."""
    return summarize(read_costs(run.folder / "costs"))


def summarize(costs: Sequence[PartCosts]) -> Timings:
    """Sum up what parts took; a rate is that of the middle part."""
    cores = sorted({one.cores for one in costs})
    methods = _methods(costs)
    return Timings(
        parts=len(costs),
        cores=join_words([str(count) for count in cores] or [MISSING], "or"),
        stages=_stages(costs),
        methods=methods,
        widths=sorted({width for one in methods for width in one.by_width}),
    )


_Amounts = list[tuple[float, str]]  # what was done, with its unit


def _done(one: PartCosts) -> dict[str, tuple[float, _Amounts]]:
    """Seconds and amounts of each stage of a part."""
    events = (1e-6 * one.events, "Mev")
    samples = 1e-6 * one.rendered_frames * one.resolution**2 * one.spp
    return {
        "rendering": (one.rendering_s, [(one.rendered_frames, "frames"), (samples, "M samples")]),
        "reading frames": (one.reading_s, [(one.frames, "frames")]),
        "simulating sensors": (
            one.simulating_s,
            [(1e-6 * one.pixel_frames, "M pixel-frames"), events],
        ),
        "keeping events for the tasks": (one.collecting_s, [events]),
        "estimating and scoring": (
            one.scoring_s,
            [(sum(method.estimates for method in one.methods), "estimates")],
        ),
    }


def _stages(costs: Sequence[PartCosts]) -> list[StageTime]:
    parts = [_done(one) for one in costs]
    total_s = sum(seconds for part in parts for seconds, _ in part.values())
    stages = []
    for name in parts[0] if parts else ():
        seconds = [part[name][0] for part in parts]
        columns = list(zip(*(part[name][1] for part in parts), strict=True))
        stages.append(
            StageTime(
                name=name,
                seconds=sum(seconds),
                share=sum(seconds) / total_s if total_s else None,
                done=[f"{digits(sum(n for n, _ in column))} {column[0][1]}" for column in columns],
                rates=[_rate(column, seconds) for column in columns],
            )
        )
    return stages


def _rate(amounts: Sequence[tuple[float, str]], seconds: Sequence[float]) -> str:
    rates = [n / s for (n, _), s in zip(amounts, seconds, strict=True) if n and s > 0]
    return f"{digits(float(np.median(rates)))} {amounts[0][1]}/s" if rates else MISSING


def _methods(costs: Sequence[PartCosts]) -> list[MethodTime]:
    found: dict[Series, dict[int, list[MethodCost]]] = {}
    for cost in (method for one in costs for method in one.methods):
        if cost.method != TASKS[cost.task].baseline:
            series = Series(cost.task, cost.method, "", cost.variant)
            found.setdefault(series, {}).setdefault(cost.width, []).append(cost)
    return [
        MethodTime(
            title=series.title,
            by_width={width: _estimate_s(costs) for width, costs in by_width.items()},
            estimates=sum(one.estimates for one in chain.from_iterable(by_width.values())),
            cpu_s=sum(one.cpu_s for one in chain.from_iterable(by_width.values())),
        )
        for series, by_width in found.items()
    ]


def _estimate_s(costs: Sequence[MethodCost]) -> tuple[float, float | None]:
    """Seconds of an estimate, and of a million of its events; None where it was given none."""
    each = [one.median_cpu_s * one.estimates / one.events for one in costs if one.events]
    estimate_s = float(np.median([one.median_cpu_s for one in costs]))
    return estimate_s, 1e6 * float(np.median(each)) if each else None


def digits(value: float) -> str:
    """A number to three digits, or to whole ones."""
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def time_text(seconds: float) -> str:
    """Three digits, in the unit that suits."""
    for factor, unit, below in ((1e6, "µs", 1e-3), (1e3, "ms", 1.0), (1.0, "s", 120.0)):
        if seconds < below:
            return f"{digits(seconds * factor)} {unit}"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
