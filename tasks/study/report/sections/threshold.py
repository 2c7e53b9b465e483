"""The report's section on the contrast threshold: scores, event rates and choices of each."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from tasks.study.report.chart import Chart
from tasks.study.report.markup import scrolling
from tasks.study.report.sections.choice import choice_cell
from tasks.study.results.choice import choose_all
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.scores import Condition, Scores, base_speed, beats
from tasks.study.results.words import MISSING, cutoff_detail, cutoff_label, rate_label, share_text


def threshold_html(found: Sequence[Scores], series: Series) -> str:
    """Render one series at base speed under several contrast thresholds, scene by scene.

    Parameters
    ----------
    found
        Scores of each threshold; what is shown are scenes, widths and cutoffs of the first.
    series
        Which method on which task.
    """
    first = found[0]
    ascending = sorted(found, key=lambda scores: scores.contrast_threshold)
    low, high = (ascending[k].contrast_threshold for k in (0, -1))
    metric = METRICS[series.metric]
    parts = [
        f'<p class="lead">One line for each sensor width; its dots are the contrast thresholds C, '
        f"from {high:g} on the left to {low:g} on the right: more events. In each place of the "
        f"table: the smallest width whose median is within {metric.negligible:g} {metric.unit} of "
        "the best, as in the choice above. All at base speed.</p>",
        _legend(first.widths(series)),
    ]
    for scene in first.scenes(series):
        panels = _panels(ascending, first, series, scene)
        parts.append(f"<h4>{escape(scene)}</h4>{panels}")
        parts.append(_choices(ascending, first, series, scene))
        numbers = _numbers(ascending, first, series, scene)
        parts.append(f"<details><summary>Numbers, {escape(scene)}</summary>{numbers}</details>")
    return "".join(parts)


def _legend(widths: list[int]) -> str:
    keys = "".join(
        f'<span><i style="background:{_colour(i)}"></i>{width} px</span>'
        for i, width in enumerate(widths)
    )
    return f'<p class="key">{keys}</p>'


def _colour(index: int) -> str:
    return f"var(--series-{index % 8})"


def _panels(ascending: list[Scores], first: Scores, series: Series, scene: str) -> str:
    """Score against event rate: a chart for each cutoff, a line for each width."""
    lines = {
        (cutoff_hz, i): _points(
            ascending, series, Condition(scene, width, cutoff_hz, base_speed(first, series))
        )
        for cutoff_hz in first.cutoffs_hz(series)
        for i, width in enumerate(first.widths(series))
    }
    points = [point for line in lines.values() for point in line]
    if not points:
        return ""
    rates, values = zip(*points, strict=True)
    metric = METRICS[series.metric]
    # From a factor of 3 on at least one of 1, 2 and 5 lies within a logarithmic axis.
    log_y = not metric.higher_is_better and max(values) > 3 * min(values) > 0
    room = 0.06 * (max(values) - min(values)) or 1.0
    better = "" if metric.higher_is_better else ", less is better"
    charts = []
    for cutoff_hz in first.cutoffs_hz(series):
        chart = Chart(
            (min(rates) / 1.3, max(rates) * 1.3),
            (min(values) / 1.2, max(values) * 1.2)
            if log_y
            else (min(values) - room, max(values) + room),
            "event rate [Mev/s]",
            f"{metric.label} [{metric.unit}]{better}",
            log_y=log_y,
        )
        for i in range(len(first.widths(series))):
            if line := lines[cutoff_hz, i]:
                x, y = zip(*line, strict=True)
                chart.line(x, y, _colour(i))
                chart.dots(x, y, _colour(i))
        label, detail = cutoff_label(cutoff_hz), cutoff_detail(cutoff_hz)
        svg = chart.svg(f"{metric.label} against event rate, {scene}, {label}; numbers are below")
        charts.append(
            f'<figure class="panel"><figcaption>{escape(label)} <small>{escape(detail)}</small>'
            f"</figcaption>{svg}</figure>"
        )
    return f'<div class="panels">{"".join(charts)}</div>'


def _points(ascending: list[Scores], series: Series, where: Condition) -> list[tuple[float, float]]:
    """(event rate in Mev/s, score) by threshold, where all samples are there and events are."""
    cells = [scores.cell(series, where) for scores in ascending]
    return [
        (cell.event_rate_hz / 1e6, cell.median)
        for cell in cells
        if cell.event_rate_hz and cell.median is not None
    ]


def _heads(ascending: list[Scores], first: Scores) -> str:
    return "".join(
        f'<th scope="col">C = {scores.contrast_threshold:g}'
        f"{', <small>as above</small>' if scores is first else ''}</th>"
        for scores in ascending
    )


def _choices(ascending: list[Scores], first: Scores, series: Series, scene: str) -> str:
    """Which width to choose: cutoffs down, thresholds across."""
    choices = [choose_all(scores, series) for scores in ascending]
    speed = base_speed(first, series)
    body = "".join(
        f'<tr><th scope="row">{escape(cutoff_label(cutoff_hz))} '
        f"<small>{escape(cutoff_detail(cutoff_hz))}</small></th>"
        + "".join(choice_cell(one.get((scene, cutoff_hz, speed)), series) for one in choices)
        + "</tr>"
        for cutoff_hz in first.cutoffs_hz(series)
    )
    table = (
        f'<table class="choice"><thead><tr><th scope="col"></th>{_heads(ascending, first)}</tr>'
        f"</thead><tbody>{body}</tbody></table>"
    )
    return scrolling(f"Choice by contrast threshold, {scene}", table)


def _numbers(ascending: list[Scores], first: Scores, series: Series, scene: str) -> str:
    """Median scores and event rates: cutoffs and widths down, thresholds across."""
    metric = METRICS[series.metric]
    speed = base_speed(first, series)
    body = []
    for cutoff_hz in first.cutoffs_hz(series):
        body.append(
            f'<tr class="block"><th colspan="{1 + len(ascending)}" scope="rowgroup"><span>'
            f"{escape(cutoff_label(cutoff_hz))} <small>{escape(cutoff_detail(cutoff_hz))}</small>"
            "</span></th></tr>"
        )
        for width in first.widths(series):
            where = Condition(scene, width, cutoff_hz, speed)
            cells = "".join(f"<td>{_number(scores, series, where)}</td>" for scores in ascending)
            body.append(f'<tr><th scope="row">{width} px</th>{cells}</tr>')
    table = (
        f'<table class="sweep"><caption><span>{escape(scene)}: median {metric.label} '
        f"[{metric.unit}] {metric.arrow}, and million events a second; struck out: no better than "
        f'doing nothing</span></caption><thead><tr><th scope="col">sensor</th>'
        f"{_heads(ascending, first)}</tr></thead><tbody>{''.join(body)}</tbody></table>"
    )
    return scrolling(f"Numbers by contrast threshold, {scene}", table)


def _number(scores: Scores, series: Series, where: Condition) -> str:
    cell = scores.cell(series, where)
    if cell.median is None:
        return MISSING
    text = METRICS[series.metric].text(cell.median)
    if beats(cell, scores.baseline(series, where), series) is False:
        text = f"<s>{text}</s>"
    failed = f", {share_text(cell.failure_share)} fail" if cell.failed.any() else ""
    return f"{text} <small>{rate_label(cell.event_rate_hz)} M/s{failed}</small>"
