"""Write the report of a run: one HTML file without network, the static figure and the tables."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from eres_render.storage.atomic import write_bytes
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError
from tasks.evaluation.timings import read_timings
from tasks.registry import TASKS
from tasks.row import read_rows
from tasks.study.claims.judge import judge_all as judge_claims
from tasks.study.claims.verdict import Status, Verdict, threshold_note
from tasks.study.report.figures import COLOURS, figure_files
from tasks.study.report.markup import scrolling
from tasks.study.report.sections.bandwidth import buses_html
from tasks.study.report.sections.choice import answer_html, choice_tables_html
from tasks.study.report.sections.comparison import to_html
from tasks.study.report.sections.failures import convergence_html
from tasks.study.report.sections.previews import previews_html
from tasks.study.report.sections.scaling import scaling_html
from tasks.study.report.sections.threshold import threshold_html
from tasks.study.report.sections.timings import costs_html
from tasks.study.report.tables_csv import to_csv
from tasks.study.report.tradeoff import Plot, plot_data
from tasks.study.results.choice import Choices, choose_all
from tasks.study.results.comparison import ComparisonTable, comparison_table
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import is_main, shown_series
from tasks.study.results.previews import Preview
from tasks.study.results.scaling import read_scaling
from tasks.study.results.scores import Scores, base_speed, by_threshold
from tasks.study.results.words import join_words

MAX_BYTES = 15_000_000
"""A report is never larger than this."""


def write_report(run_dir: Path) -> Path:
    """Write ``report.html``, ``tables.csv`` and ``figures/tradeoff_METHOD.png`` and ``.svg``.

    Parameters
    ----------
    run_dir
        Folder of a run, with ``rows.parquet``, ``environment.json`` (strings by name),
        ``study.json`` (the resolved configuration) and, if the run made any,
        ``previews/index.json`` with the PNG files that it lists, ``scaling/`` with a JSON and a
        PNG file for each scene, and ``costs/`` with a JSON file for each part.

    Returns
    -------
    Path
        The report, which appears under its name only when it is whole.

    Raises
    ------
    ResultError
        A file is missing or damaged, the rows contradict each other, or the report would be larger
        than `MAX_BYTES`.
    """
    found = by_threshold(read_rows(run_dir / "rows.parquet"))
    scores = found[0]
    environment = read_json(dict[str, str], run_dir / "environment.json", ResultError)
    config = read_json(dict[str, Any], run_dir / "study.json", ResultError)
    if not scores.series():
        rows_file = run_dir / "rows.parquet"
        raise ResultError(f"{rows_file}: only do-nothing rows, no method to report on")

    page = _page(run_dir, found, environment, config).encode()
    if len(page) > MAX_BYTES:
        raise ResultError(
            f"{run_dir}: the report would have {len(page) / 1e6:.1f} MB, more than "
            f"{MAX_BYTES / 1e6:.0f}; list fewer previews in previews/index.json"
        )
    tables = [comparison_table(one, series) for one in found for series in one.series()]
    write_bytes(run_dir / "tables.csv", to_csv(tables).encode())
    for series in filter(is_main, shown_series(scores)):
        for kind, image in figure_files(scores, series).items():
            name = re.sub(r"\W+", "_", series.method)
            write_bytes(run_dir / "figures" / f"tradeoff_{name}.{kind}", image)
    report = run_dir / "report.html"
    write_bytes(report, page)
    return report


def _page(
    run_dir: Path,
    found: list[Scores],
    environment: dict[str, str],
    config: dict[str, Any],
) -> str:
    here = Path(__file__).parent
    scores = found[0]
    series = shown_series(scores)
    choices = {one: choose_all(scores, one) for one in series}
    scaling = read_scaling(run_dir / "scaling")
    verdicts = judge_claims(scores, scaling)
    previews = run_dir / "previews"
    index = previews / "index.json"
    entries = read_json(tuple[Preview, ...], index, ResultError) if index.is_file() else ()
    plots = {one: [plot_data(scores, one, scene) for scene in scores.scenes(one)] for one in series}
    template = Template((here / "report.html").read_text())
    return template.substitute(
        title="Which event-camera resolution is enough?",
        colours=_colour_css(),
        css=(here / "report.css").read_text(),
        js=(here / "report.js").read_text(),
        kicker=_kicker(scores, environment),
        answer=_answers(choices) + _caution(scores) + _which_threshold(found),
        picker=_picker(series),
        plots="".join(_plots(plots[one], shown=one is series[0]) for one in series),
        buses=buses_html(scores, series[0]),
        scaling=scaling_html(run_dir / "scaling", scaling, _scenes(scores)),
        tables="".join(_tables(scores, one, opened=one is series[0]) for one in series),
        convergence=convergence_html(scores)
        or "<p>This run has no optical flow and no pose tracking.</p>",
        tally=f"{_tally(verdicts)} {threshold_note(found)}".strip(),
        claims=_claims(verdicts),
        choice="".join(
            _folded(one, choice_tables_html(choices[one], one), opened=one is series[0])
            for one in series
        ),
        threshold_link=' <a href="#threshold">Threshold</a>' if found[1:] else "",
        threshold=_threshold(found, list(filter(is_main, series))) if found[1:] else "",
        previews=previews_html(previews, entries),
        costs=costs_html(read_timings(run_dir / "costs")),
        provenance=_provenance(environment, config),
        reproduce=_reproduce(environment),
        plot_data=json.dumps(
            [plot for one in series for plot in plots[one]], ensure_ascii=False
        ).replace("<", "\\u003c"),
    )


def _answers(choices: Mapping[Series, Choices]) -> str:
    """The answer of the first method on each task."""
    firsts: dict[str, Series] = {}
    for one in choices:
        firsts.setdefault(one.task, one)
    named = len(firsts) > 1
    return "".join(answer_html(choices[one], one, named=named) for one in firsts.values())


def _picker(series: list[Series]) -> str:
    """A choice of task and method, where there are several."""
    if len(series) == 1:
        return ""
    groups: dict[str, list[str]] = {}
    for i, one in enumerate(series):
        groups.setdefault(one.task, []).append(f'<option value="{i}">{escape(one.name)}</option>')
    options = "".join(
        f'<optgroup label="{escape(TASKS[task].title.capitalize())}">{"".join(found)}</optgroup>'
        for task, found in groups.items()
    )
    return (
        f'<p class="picker"><label>Task and method <select id="pick">{options}</select></label></p>'
    )


def _plots(plots: list[Plot], *, shown: bool) -> str:
    hidden = "" if shown else " hidden"
    places = "".join(f'<div class="plot"><h3>{escape(plot["title"])}</h3></div>' for plot in plots)
    return f'<div class="plots"{hidden}>{places}</div>'


def _folded(series: Series, content: str, *, opened: bool) -> str:
    title = escape(series.title[0].upper() + series.title[1:])
    return f"<details{' open' * opened}><summary>{title}</summary>{content}</details>"


def _colour_css() -> str:
    def properties(theme: int) -> str:
        return " ".join(f"--series-{i}: {pair[theme]};" for i, pair in enumerate(COLOURS))

    dark = "@media (prefers-color-scheme: dark)"
    return f":root {{ {properties(0)} }}\n{dark} {{ :root {{ {properties(1)} }} }}"


def _kicker(scores: Scores, environment: Mapping[str, str]) -> str:
    parts = [
        f"eres {environment.get('eres', '')}".strip(),
        join_words(_scenes(scores)),
        _samples_text(scores),
        f"contrast threshold {scores.contrast_threshold:g}",
    ]
    return escape(" · ".join(parts))


def _scenes(scores: Scores) -> list[str]:
    return list(dict.fromkeys(s for one in scores.series() for s in scores.scenes(one)))


def _sample_counts(scores: Scores) -> set[int]:
    """Samples a scene, over all series and scenes."""
    return {scores.samples(one, scene) for one in scores.series() for scene in scores.scenes(one)}


def _samples_text(scores: Scores) -> str:
    low, high = min(_sample_counts(scores)), max(_sample_counts(scores))
    return f"{low if low == high else f'{low} to {high}'} sample{'s' * (high > 1)} a scene"


def _caution(scores: Scores) -> str:
    """Say it beside the answer where the samples are too few to tell how sure it is."""
    if min(_sample_counts(scores)) >= MIN_SAMPLES_FOR_INTERVAL:
        return ""
    return (
        f"<p>These are medians of {_samples_text(scores)}, too few to say how sure they are: "
        f"an interval needs {MIN_SAMPLES_FOR_INTERVAL}.</p>"
    )


def _which_threshold(found: list[Scores]) -> str:
    """Say which contrast threshold the page is about, where the run has several."""
    if not found[1:]:
        return ""
    first, *others = (f"{scores.contrast_threshold:g}" for scores in found)
    return (
        f"<p>All this is for a contrast threshold of {first}, as is the rest of the page; "
        f'<a href="#threshold">one section</a> compares it with {join_words(others)}.</p>'
    )


def _threshold(found: list[Scores], series: list[Series]) -> str:
    sections = "".join(
        _folded(one, threshold_html(found, one), opened=one is series[0]) for one in series
    )
    return (
        '<section id="threshold" aria-labelledby="h-threshold">\n'
        f'<h2 id="h-threshold">Contrast threshold</h2>\n{sections}\n</section>\n'
    )


def _tables(scores: Scores, series: Series, *, opened: bool) -> str:
    base = comparison_table(scores, series, [base_speed(scores, series)])
    every = comparison_table(scores, series)
    return _folded(
        series,
        f"{_table(base)}<p class='note'>{escape(base.footnote)}</p>"
        f"<details><summary>All speeds</summary>{_table(every)}</details>",
        opened=opened,
    )


def _table(table: ComparisonTable) -> str:
    return scrolling(table.title, to_html(table))


_SIGNS = {
    Status.HOLDS: "M3 9.5L7.5 14L15 4.5",
    Status.DOES_NOT_HOLD: "M4 4L14 14M14 4L4 14",
    Status.NOT_MEASURED: "M4 9H14",
}


def _tally(verdicts: list[Verdict]) -> str:
    counts = {status: sum(v.status is status for v in verdicts) for status in Status}
    tally = ", ".join(f"{status.value}: {count}" for status, count in counts.items())
    return f"{len(verdicts)} claims checked; {tally}."


def _claims(verdicts: list[Verdict]) -> str:
    items = []
    for v in verdicts:
        kind = v.status.value.replace(" ", "-")
        note = f'<p class="note">{escape(v.note)}</p>' if v.note else ""
        items.append(
            f'<li><div class="status {kind}"><svg viewBox="0 0 18 18" aria-hidden="true">'
            f'<path d="{_SIGNS[v.status]}" fill="none" stroke="currentColor" stroke-width="2.4"/>'
            f"</svg><div>{v.status.value}<small>claim {v.number}</small></div></div>"
            f"<div><h3>{escape(v.title)}</h3><p>{escape(v.statement)}</p>"
            f"<dl><div><dt>ours</dt><dd>{escape(v.ours)}</dd></div>"
            f"<div><dt>paper</dt><dd>{escape(v.paper)}</dd></div></dl>{note}</div></li>"
        )
    return f'<ol class="claims">{"".join(items)}</ol>'


def _provenance(environment: Mapping[str, str], config: Mapping[str, Any]) -> str:
    facts = "".join(
        f"<dt>{escape(k)}</dt><dd>{escape(str(v))}</dd>" for k, v in environment.items()
    )
    return (
        f'<dl class="facts">{facts}</dl><details><summary>Resolved configuration</summary>'
        f"<pre>{escape(json.dumps(config, indent=2, ensure_ascii=False))}</pre></details>"
    )


def _reproduce(environment: Mapping[str, str]) -> str:
    command = environment.get("command")
    if command is None:
        return "<p>The run did not record its command.</p>"
    return f"<pre>{escape(command)}</pre>"
