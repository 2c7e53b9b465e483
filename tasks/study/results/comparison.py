"""Median scores per condition, set beside the paper's: the numbers, and three ways to print."""

from __future__ import annotations

import csv
import html
import io
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import rich.console
from rich.text import Text

from tasks.study.results.paper import CONTRAST_THRESHOLD, source
from tasks.study.results.perturbation import is_main, shown_series
from tasks.study.results.scores import METRICS, TASKS, Cell, Condition, Scores, Series, method_label
from tasks.study.results.words import (
    MISSING,
    cutoff_detail,
    cutoff_label,
    rate_label,
    share_text,
    speed_label,
)
from tasks.table import Table


@dataclass(frozen=True, slots=True)
class Entry:
    """Ours and the paper's median in one place of a table."""

    cell: Cell
    paper: float | None
    best: bool = False  # of the widths of this block, in this column; needs the whole column
    paper_best: bool = False
    beats_nothing: bool | None = None  # None: one of both was not measured

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's, or None where either is missing."""
        if self.cell.median is None or self.paper is None:
            return None
        return self.cell.median - self.paper


@dataclass(frozen=True, slots=True)
class Line:
    """One width across the cutoffs, of the method or of doing nothing.

    `width` is None for the score of doing nothing where that is the same at every width.
    """

    width: int | None
    entries: tuple[Entry, ...]
    nothing: bool = False


@dataclass(frozen=True, slots=True)
class Block:
    """All widths on one scene at one speed; `lines` ends with doing nothing."""

    scene: str
    speed: float
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class ComparisonTable:
    """Rows: scene x speed x width; columns: cutoffs; in each place ours and the paper's."""

    series: Series
    contrast_threshold: float
    cutoffs_hz: tuple[float, ...]
    blocks: tuple[Block, ...]

    @property
    def title(self) -> str:
        """Title with metric, unit and the direction that is better."""
        metric = METRICS[self.series.metric]
        name = self.series.title[0].upper() + self.series.title[1:]
        return f"{name}: median {metric.label} [{metric.unit}] {metric.arrow}"

    @property
    def source(self) -> str | None:
        """The paper's table to compare with, None where it has none."""
        if self.contrast_threshold != CONTRAST_THRESHOLD:
            return None
        return source(self.series.task, self.series.method)

    @property
    def footnote(self) -> str:
        """What the columns and marks mean."""
        label = self.source
        paper = f"paper: its {label}; Δ: ours minus the paper's" if label else "not in the paper"
        if self.contrast_threshold != CONTRAST_THRESHOLD:
            paper += f" at a contrast threshold of {self.contrast_threshold:g}"
        marks = {
            "reconstruction": "M/s: million events a second",
            "video": "M/s: million events a second",
            "flow": "fail: share of features that failed",
            "tracking": "ok: share of trials that succeed",
        }
        return (
            f"{paper}; bold: best of the column; struck out: no "
            f"better than doing nothing; {marks[self.series.task]}; {MISSING}: missing, or not all "
            "samples there (n of N)"
        )


def main_tables(scores: Scores) -> list[ComparisonTable]:
    """The paper's methods, and a user's own, at base speed, as in its Tables 2 and 3."""
    return [
        comparison_table(scores, series, [base_speed(scores, series)])
        for series in shown_series(scores)
        if is_main(series)
    ]


def base_speed(scores: Scores, series: Series) -> float:
    """The speed factor of a series that is nearest to 1."""
    return min(scores.speeds(series), key=lambda speed: abs(math.log(speed)))


def comparison_table(
    scores: Scores, series: Series, speeds: Iterable[float] | None = None
) -> ComparisonTable:
    """Set our medians beside the paper's.

    Parameters
    ----------
    scores
        The rows of a run.
    series
        Which method on which task.
    speeds
        Speed factors to show, all that were run when None. ``[1.0]`` gives the layout of the
        paper's Table 2, all of them that of its appendix tables.
    """
    cutoffs_hz = tuple(scores.cutoffs_hz(series))
    shown = scores.speeds(series) if speeds is None else list(speeds)
    blocks = tuple(
        _block(scores, series, scene, speed, cutoffs_hz)
        for scene in scores.scenes(series)
        for speed in shown
        if speed in scores.speeds(series, scene)
    )
    return ComparisonTable(series, scores.contrast_threshold, cutoffs_hz, blocks)


def _block(
    scores: Scores, series: Series, scene: str, speed: float, cutoffs_hz: tuple[float, ...]
) -> Block:
    widths = scores.widths(series)
    columns, nothings = [], []
    for cutoff_hz in cutoffs_hz:
        where = [Condition(scene, width, cutoff_hz, speed) for width in widths]
        cells = [scores.cell(series, condition) for condition in where]
        nothing = [scores.baseline(series, condition) for condition in where]
        paper = [scores.published(series, condition) for condition in where]
        best = _best([cell.median for cell in cells], series.metric)
        paper_best = _best(paper, series.metric)
        columns.append(
            [
                Entry(cell, value, i == best, i == paper_best, beats(cell, idle, series))
                for i, (cell, value, idle) in enumerate(zip(cells, paper, nothing, strict=True))
            ]
        )
        nothings.append([Entry(cell, None) for cell in nothing])
    lines = [Line(width, tuple(column[i] for column in columns)) for i, width in enumerate(widths)]
    if all(_same([entry.cell.median for entry in column]) for column in nothings):
        idle_lines = [Line(None, tuple(column[0] for column in nothings), nothing=True)]
    else:
        idle_lines = [
            Line(width, tuple(column[i] for column in nothings), nothing=True)
            for i, width in enumerate(widths)
        ]
    return Block(scene, speed, (*lines, *idle_lines))


def beats(cell: Cell, nothing: Cell, series: Series) -> bool | None:
    """Whether a score is better than that of doing nothing, None where one is missing."""
    if cell.median is None or nothing.median is None:
        return None
    return METRICS[series.metric].sign * (cell.median - nothing.median) > 0


def _same(values: list[float | None]) -> bool:
    first, *others = values
    if first is None:
        return all(value is None for value in others)
    return all(value is not None and math.isclose(value, first, rel_tol=1e-6) for value in others)


def _best(values: list[float | None], metric: str) -> int | None:
    """Index of the best value, or None when one is missing: it could have been the best."""
    present = [value for value in values if value is not None]
    if not present or len(present) < len(values):
        return None
    return present.index(max(present, key=lambda value: METRICS[metric].sign * value))


# ---- columns -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Column:
    """One of the columns that every cutoff has."""

    head: str
    kind: str  # CSS class
    text: Callable[[Entry, Line], str]
    in_terminal: bool = True  # 80 columns have no room for all


def _columns(table: ComparisonTable) -> list[_Column]:
    series = table.series
    metric = METRICS[series.metric]

    def number(value: float | None, sign: str = "") -> str:
        return MISSING if value is None else metric.text(value, sign)

    def ours(entry: Entry, line: Line) -> str:
        cell = entry.cell
        if 0 < len(cell.values) < cell.expected:
            return f"{MISSING} ({len(cell.values)} of {cell.expected})"
        return number(cell.median)

    def native(entry: Entry, line: Line) -> str:
        return "" if line.width is None else number(native_px(entry.cell.median, line, series))

    def share(entry: Entry, line: Line) -> str:
        failed = entry.cell.failure_share
        if line.nothing:
            return ""
        if failed is None:
            return MISSING
        shown = share_text(1 - failed if series.task == "tracking" else failed)
        return shown.replace("\u202f", "")

    def rate(entry: Entry, line: Line) -> str:
        return rate_label(None if line.nothing else entry.cell.event_rate_hz)

    columns = [_Column("ours", "ours", ours)]
    if table.source is not None:
        columns += [
            _Column("paper", "paper", lambda entry, _: number(entry.paper)),
            _Column("Δ", "difference", lambda entry, _: number(entry.difference, "+")),
        ]
    if metric.reference_width_px is not None:
        columns.append(_Column("native px", "rate", native, in_terminal=False))
    if series.task == "flow":
        columns.append(_Column("fail", "rate", share))
    if series.task == "tracking":
        columns.append(_Column("ok", "rate", share))
    shares = series.task in ("flow", "tracking")
    return [*columns, _Column("M/s", "rate", rate, in_terminal=not shares)]


def native_px(value: float | None, line: Line, series: Series) -> float | None:
    """A score in pixels of the sensor, None where it is missing or not in pixels."""
    reference_px = METRICS[series.metric].reference_width_px
    if value is None or line.width is None or reference_px is None:
        return None
    return value * line.width / reference_px


def _line_label(line: Line, series: Series) -> str:
    if not line.nothing:
        return f"{line.width} px"
    label = method_label(TASKS[series.task].baseline)
    return label if line.width is None else f"{label}, {line.width} px"


# ---- the three ways to print -------------------------------------------------------------------


def to_rich(table: ComparisonTable) -> rich.console.Group:
    """Render for a terminal of 80 columns or more, each block under its own heading."""
    parts: list[rich.console.RenderableType] = [Text(table.title, "bold")]
    for block in table.blocks:
        parts += [Text(f"\n{block.scene}, {speed_label(block.scene, block.speed)}", "italic")]
        parts += [_rich_block(block, table)]
    return rich.console.Group(*parts, Text(f"\n{table.footnote}", "dim"))


def _rich_block(block: Block, table: ComparisonTable) -> Table:
    shown = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")
    shown.add_column("", no_wrap=True)
    columns = [column for column in _columns(table) if column.in_terminal]
    for cutoff_hz in table.cutoffs_hz:
        for column in columns:
            head = cutoff_label(cutoff_hz) if column.kind == "ours" else column.head
            dim = "dim" if column.kind in ("paper", "rate") else ""
            shown.add_column(head, justify="right", style=dim, no_wrap=True)
    for line in block.lines:
        cells = [Text("do nothing" if line.width is None else _line_label(line, table.series))]
        for entry in line.entries:
            styles = {
                "ours": _style(entry.best, entry.beats_nothing is False),
                "paper": _style(entry.paper_best, False),
            }
            cells += [Text(c.text(entry, line), styles.get(c.kind, "")) for c in columns]
        shown.add_row(*cells)
    return shown


def _style(best: bool, idle: bool) -> str:
    return " ".join(["bold"] * best + ["strike"] * idle)


def to_html(table: ComparisonTable) -> str:
    """Render as one ``<table>``, each block a ``<tbody>``."""
    columns = _columns(table)
    groups = "".join(
        f'<th scope="colgroup" colspan="{len(columns)}">{html.escape(cutoff_label(c))} '
        f"<small>{html.escape(cutoff_detail(c))}</small></th>"
        for c in table.cutoffs_hz
    )
    heads = "".join(f'<th scope="col">{column.head}</th>' for column in columns)
    parts = [
        f'<table class="scores"><caption><span>{html.escape(table.title)}</span></caption>',
        f'<thead><tr><th rowspan="2" scope="col">sensor</th>{groups}</tr>',
        f"<tr>{heads * len(table.cutoffs_hz)}</tr></thead>",
    ]
    for block in table.blocks:
        speed = speed_label(block.scene, block.speed)
        title = f"{html.escape(block.scene)} <small>{speed}</small>"
        span = 1 + len(columns) * len(table.cutoffs_hz)
        parts.append(
            f'<tbody><tr class="block"><th scope="rowgroup" colspan="{span}">'
            f"<span>{title}</span></th></tr>"
        )
        for line in block.lines:
            label = html.escape(_line_label(line, table.series))
            kind = ' class="baseline"' if line.nothing else ""
            cells = "".join(
                _html_cell(column, entry, line) for entry in line.entries for column in columns
            )
            parts.append(f'<tr{kind}><th scope="row">{label}</th>{cells}</tr>')
        parts.append("</tbody>")
    parts.append("</table>")
    return "\n".join(parts)


def _html_cell(column: _Column, entry: Entry, line: Line) -> str:
    text = column.text(entry, line)
    if column.kind == "ours" and entry.beats_nothing is False:
        text = f"<s>{text}</s>"
    if {"ours": entry.best, "paper": entry.paper_best}.get(column.kind, False):
        text = f"<strong>{text}</strong>"
    return f'<td class="{column.kind}">{text}</td>'


_CSV_COLUMNS = (
    *("scene", "task", "method", "variant", "metric"),
    *("width", "cutoff_hz", "contrast_threshold", "speed"),
    *("values", "expected_values", "median", "paper", "difference", "event_rate_mev_s", "best"),
    *("native_px", "failure_share", "beats_nothing"),
)


def to_csv(tables: Iterable[ComparisonTable]) -> str:
    """Render as tidy CSV, one line a cell; what is missing is empty."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    for table in tables:
        for block in table.blocks:
            for line in block.lines:
                for cutoff_hz, entry in zip(table.cutoffs_hz, line.entries, strict=True):
                    writer.writerow(_csv_line(table, block, line, cutoff_hz, entry))
    return file.getvalue()


def _csv_line(
    table: ComparisonTable, block: Block, line: Line, cutoff_hz: float, entry: Entry
) -> list[str | int | float]:
    cell, series = entry.cell, table.series
    rate = None if line.nothing else cell.event_rate_hz
    failed = None if line.nothing else cell.failure_share

    def text(number: float | None) -> str:
        return "" if number is None else f"{number:.6g}"

    return [
        *(block.scene, series.task),
        TASKS[series.task].baseline if line.nothing else series.method,
        *(series.variant, series.metric),
        *(line.width or "", cutoff_hz, table.contrast_threshold, block.speed),
        *(len(cell.values), cell.expected),
        *(text(cell.median), text(entry.paper), text(entry.difference)),
        *(text(rate and rate / 1e6), int(entry.best)),
        *(text(native_px(cell.median, line, series)), text(failed)),
        "" if entry.beats_nothing is None else int(entry.beats_nothing),
    ]
