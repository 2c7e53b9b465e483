"""The report's section on how far off pose tracking may start, and on who fails."""

from __future__ import annotations

from html import escape

import numpy as np

from tasks.study.report.chart import Chart
from tasks.study.report.markup import scrolling
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.perturbation import (
    REQUIRED_SUCCESS,
    TRACKING,
    ideal_success,
    judged_series,
    sigma_mm,
    sweep,
)
from tasks.study.results.scores import Condition, Scores, base_speed
from tasks.study.results.words import MISSING, cutoff_detail, cutoff_label, share_text


def convergence_html(scores: Scores) -> str:
    """Render the section; nothing for a run without flow and tracking."""
    methods = dict.fromkeys(one.method for one in scores.series() if one.task == "tracking")
    swept = {method: found for method in methods if (found := sweep(scores, method))}
    parts = [_sweep_html(scores, found) for found in swept.values()]
    if swept:
        parts.insert(0, _lead(scores))
    return "".join(parts) + _failures_html(scores)


def _lead(scores: Scores) -> str:
    judged = judged_series(scores)
    rates = ", ".join(
        f"{one.variant.removeprefix('sigma ')}: {share_text(ideal_success(scores, one))}"
        for one in sweep(scores, TRACKING.method)
    )
    what = (
        f"Tables and claims take {judged.variant.removeprefix('sigma ')}, the largest that "
        f"succeeds at least {share_text(REQUIRED_SUCCESS)} of the time"
        if judged
        else f"No claim is judged, as none succeeds {share_text(REQUIRED_SUCCESS)} of the time"
    )
    return (
        "<h3>How far off pose tracking may start</h3>"
        '<p class="lead">The initial path is off by a random shift of every control point, with '
        "this standard deviation in each component. A trial succeeds if it ends nearer than half "
        f"of the initial error; the others count too. {what} in ideal light at base speed at "
        f"the median width ({rates}).</p>"
    )


def _sweep_html(scores: Scores, found: list[Series]) -> str:
    parts = [f"<h4>{escape(found[0]._replace(variant='').name)}</h4>"]
    if len(found) > 1:
        widths = scores.widths(found[0])
        keys = "".join(
            f'<span><i style="background:var(--series-{i % 8})"></i>{width} px</span>'
            for i, width in enumerate(widths)
        )
        charts = "".join(_chart(scores, found, cutoff) for cutoff in scores.cutoffs_hz(found[0]))
        parts.append(f'<p class="key">{keys}</p><div class="panels">{charts}</div>')
    tables = "".join(_table(scores, found, scene) for scene in scores.scenes(found[0]))
    return "".join(parts) + f"<details><summary>Numbers by scene</summary>{tables}</details>"


def _chart(scores: Scores, found: list[Series], cutoff_hz: float) -> str:
    """Success over the perturbation at base speed, a line for each width, over all scenes."""
    sigmas = [sigma for one in found if (sigma := sigma_mm(one.variant)) is not None]
    chart = Chart(
        (min(sigmas) / 1.3, max(sigmas) * 1.3),
        (-4, 104),
        "standard deviation of the perturbation [mm]",
        "trials that succeed [%]",
        log_y=False,
    )
    for i, width in enumerate(scores.widths(found[0])):
        shares = [_pooled_success(scores, one, width, cutoff_hz) for one in found]
        points = {x: 100 * y for x, y in zip(sigmas, shares, strict=True) if y is not None}
        if points:
            chart.line(points.keys(), points.values(), f"var(--series-{i % 8})")
            chart.dots(points.keys(), points.values(), f"var(--series-{i % 8})")
    label, detail = cutoff_label(cutoff_hz), cutoff_detail(cutoff_hz)
    svg = chart.svg(f"Success over the perturbation, {label}; the tables below have the numbers")
    return (
        f'<figure class="panel"><figcaption>{escape(label)} <small>{escape(detail)}</small>'
        f"</figcaption>{svg}</figure>"
    )


def _pooled_success(scores: Scores, series: Series, width: int, cutoff_hz: float) -> float | None:
    speed = base_speed(scores, series)
    cells = [
        scores.cell(series, Condition(scene, width, cutoff_hz, speed))
        for scene in scores.scenes(series)
    ]
    failed = [cell.failed for cell in cells if cell.complete]
    return float(1 - np.concatenate(failed).mean()) if failed else None


def _table(scores: Scores, found: list[Series], scene: str) -> str:
    metric = METRICS[found[0].metric]
    widths = scores.widths(found[0])
    speed = base_speed(scores, found[0])
    heads = "".join(f'<th scope="col">{width} px</th>' for width in widths)
    body = []
    for cutoff_hz in scores.cutoffs_hz(found[0]):
        body.append(
            f'<tr class="block"><th colspan="{1 + len(widths)}" scope="rowgroup"><span>'
            f"{escape(cutoff_label(cutoff_hz))} <small>{escape(cutoff_detail(cutoff_hz))}</small>"
            "</span></th></tr>"
        )
        for one in found:
            cells = []
            for width in widths:
                cell = scores.cell(one, Condition(scene, width, cutoff_hz, speed))
                if cell.median is None or cell.failure_share is None:
                    cells.append(f"<td>{MISSING}</td>")
                    continue
                error = f"{metric.text(cell.median)} {metric.unit}"
                cells.append(
                    f"<td>{share_text(1 - cell.failure_share)} <small>{error}</small></td>"
                )
            body.append(f'<tr><th scope="row">{escape(one.variant)}</th>{"".join(cells)}</tr>')
    table = (
        f'<table class="sweep"><caption><span>{escape(scene)}: trials that succeed, and the '
        f"median error of all</span></caption><thead><tr><th></th>{heads}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table>"
    )
    return scrolling(f"Perturbations, {scene}", table)


def _failures_html(scores: Scores) -> str:
    """A line for each series that can give up: how often, and why."""
    able = [one for one in scores.series() if one.task in ("flow", "tracking")]
    if not able:
        return ""
    rows = []
    for one in able:
        cells = [scores.cell(one, where) for where in scores.conditions(one)]
        total = sum(len(cell.values) for cell in cells)
        reasons = scores.failures(one)
        failed = sum(reasons.values())
        why = ", ".join(f"{escape(reason)} ({count:,})" for reason, count in reasons.most_common(4))
        rows.append(
            f'<tr><th scope="row">{escape(one.title)}</th><td>{failed:,} of {total:,}</td>'
            f"<td>{share_text(failed / total if total else None)}</td>"
            f'<td class="why">{why}</td></tr>'
        )
    table = (
        '<table class="failures"><thead><tr><th scope="col">method</th>'
        '<th scope="col">failed</th><th scope="col">share</th>'
        '<th scope="col" class="why">why</th></tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table>"
    )
    return (
        "<h3>Who failed, and why</h3>"
        '<p class="lead">Features and trials on which a method gave up or ended far off, under all '
        "conditions together. None is dropped: where a method gave up, the error of its starting "
        "point counts.</p>" + scrolling("Failures", table)
    )
