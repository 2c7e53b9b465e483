"""The report's section on what the run took: stage by stage, and method by method."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from itertools import chain

import numpy as np

from tasks.evaluation.timings import JobTimings, MethodTimings
from tasks.registry import TASKS
from tasks.study.report.markup import scrolling
from tasks.study.results.metrics import Series
from tasks.study.results.words import MISSING, join_words


def costs_html(costs: Sequence[JobTimings]) -> str:
    """Render the section.

    Parameters
    ----------
    costs
        Of all parts of the run that recorded them.
    """
    if not costs:
        return "<p>This run has no timings; it was made before they were recorded.</p>"
    cores = join_words([str(count) for count in sorted({one.cores for one in costs})], "or")
    parts = f"{len(costs)} part{'s' * (len(costs) > 1)}"
    return (
        f'<p class="lead">Measured while this run was made, {parts} on {cores} '
        f"core{'s' * (cores != '1')}. A rate is that of the middle part, since the first one also "
        "compiles. Frames that were in the cache were not rendered again. Whatever else the "
        "machine did at the time is in these numbers.</p>"
        f"{_stages_html(costs)}<h3>Methods</h3>"
        '<p class="lead">Time of one estimate, which is an image, the flow of a patch or a path, '
        "on one core: the median over a part’s estimates, and over parts. Below it, that time for "
        "a million of the events that an estimate is given on average.</p>" + _methods_html(costs)
    )


@dataclass(frozen=True, slots=True)
class _Stage:
    name: str
    seconds: Callable[[JobTimings], float]
    amounts: Callable[[JobTimings], Sequence[tuple[float, str]]]  # done in that time, with units


_STAGES = (
    _Stage(
        "rendering",
        lambda one: one.rendering_s,
        lambda one: [
            (one.rendered_frames, "frames"),
            (1e-6 * one.rendered_frames * one.resolution**2 * one.spp, "M samples"),
        ],
    ),
    _Stage("reading frames", lambda one: one.reading_s, lambda one: [(one.frames, "frames")]),
    _Stage(
        "simulating sensors",
        lambda one: one.simulating_s,
        lambda one: [(1e-6 * one.pixel_frames, "M pixel-frames"), (1e-6 * one.events, "Mev")],
    ),
    _Stage(
        "keeping events for the tasks",
        lambda one: one.collecting_s,
        lambda one: [(1e-6 * one.events, "Mev")],
    ),
    _Stage(
        "estimating and scoring",
        lambda one: one.scoring_s,
        lambda one: [(sum(method.estimates for method in one.methods), "estimates")],
    ),
)


def _stages_html(costs: Sequence[JobTimings]) -> str:
    total_s = sum(stage.seconds(one) for stage in _STAGES for one in costs)
    body = []
    for stage in _STAGES:
        seconds = sum(stage.seconds(one) for one in costs)
        time = _time_text(seconds) if seconds else MISSING
        share = f"{100 * seconds / total_s:.0f}&#8239;%" if total_s else MISSING
        columns = list(zip(*(stage.amounts(one) for one in costs), strict=True))
        done = [f"{_number(sum(v for v, _ in column))} {column[0][1]}" for column in columns]
        rates = [_rate_text(column, stage, costs) for column in columns]
        body.append(
            f'<tr><th scope="row">{stage.name}</th><td>{time}</td><td>{share}</td>'
            f'<td class="text">{"<br>".join(done)}</td>'
            f'<td class="text">{"<br>".join(rates)}</td></tr>'
        )
    table = (
        '<table class="costs"><caption><span>Stages, all parts together</span></caption><thead>'
        '<tr><th scope="col">stage</th><th scope="col">time</th><th scope="col">share</th>'
        '<th scope="col" class="text">of</th><th scope="col" class="text">rate</th></tr></thead>'
        f"<tbody>{''.join(body)}</tbody></table>"
    )
    return scrolling("Time of each stage", table)


def _rate_text(
    amounts: Sequence[tuple[float, str]], stage: _Stage, costs: Sequence[JobTimings]
) -> str:
    rates = [
        amount / stage.seconds(one)
        for (amount, _), one in zip(amounts, costs, strict=True)
        if amount and stage.seconds(one) > 0
    ]
    return f"{_number(float(np.median(rates)))} {amounts[0][1]}/s" if rates else MISSING


def _methods_html(costs: Sequence[JobTimings]) -> str:
    found: dict[Series, dict[int, list[MethodTimings]]] = {}
    for cost in (method for one in costs for method in one.methods):
        if cost.method != TASKS[cost.task].baseline:
            series = Series(cost.task, cost.method, "", cost.variant)
            found.setdefault(series, {}).setdefault(cost.width, []).append(cost)
    widths = sorted({width for by_width in found.values() for width in by_width})
    heads = "".join(f'<th scope="col">{width} px</th>' for width in widths)
    body = []
    for series, by_width in found.items():
        cells = "".join(_method_cell(by_width.get(width, [])) for width in widths)
        every = list(chain.from_iterable(by_width.values()))
        body.append(
            f'<tr><th scope="row">{escape(series.title)}</th>{cells}'
            f"<td>{sum(one.estimates for one in every):,}</td>"
            f"<td>{_time_text(sum(one.cpu_s for one in every))}</td></tr>"
        )
    table = (
        '<table class="costs"><caption><span>Time of an estimate, by sensor</span></caption>'
        f'<thead><tr><th scope="col">method</th>{heads}<th scope="col">estimates</th>'
        f'<th scope="col">all of them</th></tr></thead><tbody>{"".join(body)}</tbody></table>'
    )
    return scrolling("Time of each method", table)


def _method_cell(costs: Sequence[MethodTimings]) -> str:
    if not costs:
        return f"<td>{MISSING}</td>"
    estimate_s = float(np.median([one.median_cpu_s for one in costs]))
    events = [one.median_cpu_s * one.estimates / one.events for one in costs if one.events]
    each = f"{_time_text(1e6 * float(np.median(events)))} / Mev" if events else "no events"
    return f"<td>{_time_text(estimate_s)}<br><small>{each}</small></td>"


def _number(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def _time_text(seconds: float) -> str:
    """Three digits, in the unit that suits."""
    for factor, unit, below in ((1e6, "µs", 1e-3), (1e3, "ms", 1.0), (1.0, "s", 120.0)):
        if seconds < below:
            return f"{_number(seconds * factor)} {unit}"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"
