"""Median scores per condition, set beside the paper's: the numbers, and three ways to print."""

from __future__ import annotations

import csv
import html
import io
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rich.console
import rich.table
from rich.text import Text

from tasks.errors import ResultError
from tasks.row import Row
from tasks.study.paper import BASE_SPEED_M_PER_S, published, source

MISSING = "–"


@dataclass(frozen=True, slots=True)
class Metric:
    """How a metric is named, printed and compared."""

    label: str
    unit: str
    higher_is_better: bool
    negligible: float  # a difference of this size or less makes no difference in practice
    decimals: int


METRICS = {
    "psnr_db": Metric("PSNR", "dB", higher_is_better=True, negligible=0.1, decimals=2),
}

BASELINES = {"reconstruction": "no_events"}
"""For each task, the method that does nothing with the events."""


class Series(NamedTuple):
    """A method on a task, judged by a metric: what one table or one plot shows."""

    task: str
    method: str
    metric: str

    @property
    def title(self) -> str:
        """Task and method in words, as in "reconstruction by event integration"."""
        return f"{self.task} by {self.method.replace('_', ' ')}"


class Condition(NamedTuple):
    """Where a score was taken."""

    scene: str
    width: int  # px
    cutoff_hz: float
    speed: float  # factor on the base speed


@dataclass(frozen=True, slots=True)
class Cell:
    """All samples of one series under one condition.

    Attributes
    ----------
    values : (N,) float64
        Finite scores, by ascending sample index, in the metric's unit.
    event_rates_hz : (N,) float64
        Events per second of the whole sensor, for the same samples.
    expected : int
        How many samples the other cells of this series have on this scene.
    """

    values: np.ndarray
    event_rates_hz: np.ndarray
    expected: int

    @property
    def complete(self) -> bool:
        """Whether every expected sample is there; only then the cell has medians."""
        return len(self.values) == self.expected > 0

    @property
    def median(self) -> float | None:
        """Median score, or None when samples are missing: nothing averages over survivors."""
        return float(np.median(self.values)) if self.complete else None

    @property
    def event_rate_hz(self) -> float | None:
        """Median event rate of the whole sensor in events per second, or None as `median`."""
        return float(np.median(self.event_rates_hz)) if self.complete else None


class Scores:
    """The rows of a run, grouped into cells.

    Parameters
    ----------
    rows
        Result rows in any order. A sample whose value is not finite counts as missing.

    Raises
    ------
    ResultError
        There are no rows, a task or metric is unknown, or two rows are of the same sample of the
        same cell.
    """

    def __init__(self, rows: Iterable[Row]) -> None:
        samples: dict[tuple[Series, Condition], dict[int, Row]] = {}
        for row in rows:
            series = Series(row.task, row.method, row.metric)
            condition = Condition(row.scene, row.width, row.cutoff_hz, row.speed)
            for field, name, known in (
                ("task", row.task, sorted(BASELINES)),
                ("metric", row.metric, sorted(METRICS)),
            ):
                if name not in known:
                    raise ResultError(f"unknown {field} {name!r}; expected {' or '.join(known)}")
            cell = samples.setdefault((series, condition), {})
            if row.sample in cell:
                raise ResultError(f"two rows of sample {row.sample} of {series}, {condition}")
            cell[row.sample] = row
        if not samples:
            raise ResultError("there are no rows to make tables, claims or a report from")
        self._rows = samples
        self._indices: dict[tuple[Series, str], set[int]] = {}
        for (series, condition), cell in samples.items():
            self._indices.setdefault((series, condition.scene), set()).update(cell)

    def series(self) -> list[Series]:
        """Every series but the do-nothing baselines, in the order of the rows."""
        found = dict.fromkeys(series for series, _ in self._rows)
        return [series for series in found if series.method != BASELINES[series.task]]

    def scenes(self, series: Series) -> list[str]:
        """Scenes of a series, in the order of the rows."""
        return list(dict.fromkeys(condition.scene for condition in self._conditions(series)))

    def widths(self, series: Series) -> list[int]:
        """Sensor widths of a series, px, ascending."""
        return sorted({condition.width for condition in self._conditions(series)})

    def cutoffs_hz(self, series: Series) -> list[float]:
        """Cutoffs of a series, Hz, from ideal (inf) down."""
        return sorted({condition.cutoff_hz for condition in self._conditions(series)}, reverse=True)

    def speeds(self, series: Series) -> list[float]:
        """Speed factors of a series, ascending."""
        return sorted({condition.speed for condition in self._conditions(series)})

    def cell(self, series: Series, condition: Condition) -> Cell:
        """Return one cell; where nothing was measured it has no values."""
        rows = self._rows.get((series, condition), {})
        return _cell_of(rows, self._indices.get((series, condition.scene), set()))

    def samples(self, series: Series, scene: str) -> int:
        """How many samples a complete cell of a series has on a scene."""
        return len(self._indices.get((series, scene), set()))

    def baseline(self, series: Series, scene: str, cutoff_hz: float, speed: float) -> Cell:
        """Return the score of doing nothing, over the samples of `series` on `scene`.

        The score of doing nothing is not a matter of the sensor, so it is looked up at every width
        that has it and must be the same.

        Raises
        ------
        ResultError
            Two widths have different scores for the same sample.
        """
        nothing = Series(series.task, BASELINES[series.task], series.metric)
        pooled: dict[int, Row] = {}
        for condition in self._conditions(nothing):
            if (condition.scene, condition.cutoff_hz, condition.speed) != (scene, cutoff_hz, speed):
                continue
            for sample, row in self._rows[nothing, condition].items():
                other = pooled.setdefault(sample, row)
                if not math.isclose(other.value, row.value, rel_tol=1e-6):
                    raise ResultError(
                        f"{nothing.method} on {scene}, sample {sample}, scores {other.value:g} at "
                        f"{other.width} px and {row.value:g} at {row.width} px; expected the same"
                    )
        return _cell_of(pooled, self._indices.get((series, scene), set()))

    def _conditions(self, series: Series) -> list[Condition]:
        return [condition for other, condition in self._rows if other == series]


def _cell_of(rows: Mapping[int, Row], expected: set[int]) -> Cell:
    kept = [rows[i] for i in sorted(expected & rows.keys()) if math.isfinite(rows[i].value)]
    return Cell(
        values=np.array([row.value for row in kept], dtype=np.float64),
        event_rates_hz=np.array([row.event_rate_hz for row in kept], dtype=np.float64),
        expected=len(expected),
    )


@dataclass(frozen=True, slots=True)
class Entry:
    """Ours and the paper's median in one place of a table."""

    cell: Cell
    paper: float | None
    best: bool = False  # of the widths of this block, in this column; needs the whole column
    paper_best: bool = False

    @property
    def difference(self) -> float | None:
        """Ours minus the paper's, or None where either is missing."""
        if self.cell.median is None or self.paper is None:
            return None
        return self.cell.median - self.paper


@dataclass(frozen=True, slots=True)
class Line:
    """One width, or the do-nothing baseline (`width` None), across the cutoffs."""

    width: int | None
    entries: tuple[Entry, ...]


@dataclass(frozen=True, slots=True)
class Block:
    """All widths on one scene at one speed; `lines` ends with the baseline."""

    scene: str
    speed: float
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class ComparisonTable:
    """Rows: scene x speed x width; columns: cutoffs; in each place ours and the paper's."""

    series: Series
    cutoffs_hz: tuple[float, ...]
    blocks: tuple[Block, ...]

    @property
    def title(self) -> str:
        """Title with metric, unit and the direction that is better."""
        metric = METRICS[self.series.metric]
        arrow = "↑" if metric.higher_is_better else "↓"
        name = self.series.title.capitalize()
        return f"{name}: median {metric.label} [{metric.unit}] {arrow}"

    @property
    def footnote(self) -> str:
        """What the columns and marks mean."""
        label = source(self.series.task, self.series.method)
        paper = f"its {label}" if label else "has no such table"
        return (
            f"paper: {paper}; Δ: ours minus the paper's; bold: best of the column; "
            f"{MISSING}: missing, or not all samples there (n of N)"
        )


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
    )
    return ComparisonTable(series, cutoffs_hz, blocks)


def _block(
    scores: Scores, series: Series, scene: str, speed: float, cutoffs_hz: tuple[float, ...]
) -> Block:
    widths = scores.widths(series)
    columns = []
    for cutoff_hz in cutoffs_hz:
        cells = [scores.cell(series, Condition(scene, width, cutoff_hz, speed)) for width in widths]
        paper = [
            published(scene, series.task, series.method, width, cutoff_hz, speed, series.metric)
            for width in widths
        ]
        best = _best([cell.median for cell in cells], series.metric)
        paper_best = _best(paper, series.metric)
        columns.append(
            [
                Entry(cell, value, i == best, i == paper_best)
                for i, (cell, value) in enumerate(zip(cells, paper, strict=True))
            ]
        )
    lines = [Line(width, tuple(column[i] for column in columns)) for i, width in enumerate(widths)]
    nothing = [Entry(scores.baseline(series, scene, c, speed), None) for c in cutoffs_hz]
    return Block(scene, speed, (*lines, Line(None, tuple(nothing))))


def _best(values: list[float | None], metric: str) -> int | None:
    """Index of the best value, or None when one is missing: it could have been the best."""
    present = [value for value in values if value is not None]
    if not present or len(present) < len(values):
        return None
    pick = max if METRICS[metric].higher_is_better else min
    return present.index(pick(present))


# ---- labels ------------------------------------------------------------------------------------


def cutoff_label(cutoff_hz: float) -> str:
    """Name a cutoff as the paper does: ideal, day, night; any other by its frequency."""
    return {math.inf: "ideal", 200.0: "day", 50.0: "night"}.get(cutoff_hz, f"{cutoff_hz:g} Hz")


def cutoff_detail(cutoff_hz: float) -> str:
    """Frequency of a cutoff in words."""
    return "no cutoff" if math.isinf(cutoff_hz) else f"cutoff {cutoff_hz:g} Hz"


def speed_label(scene: str, speed: float) -> str:
    """Speed factor to two digits (the paper's 1.3), with m/s where the paper states them."""
    base = BASE_SPEED_M_PER_S.get(scene)
    metres = "" if base is None else f" ({base * speed:.1f} m/s)"
    return f"speed {speed:.2g}{metres}"


def _line_label(line: Line, series: Series) -> str:
    return f"{line.width} px" if line.width else BASELINES[series.task].replace("_", " ")


def _texts(entry: Entry, table: ComparisonTable, line: Line) -> tuple[str, str, str, str]:
    """Ours, the paper's, the difference and the event rate in Mev/s, as printed."""
    metric = METRICS[table.series.metric]
    cell = entry.cell

    def number(value: float | None, sign: str = "") -> str:
        return MISSING if value is None else number_text(value, metric.decimals, sign)

    ours = number(cell.median)
    if 0 < len(cell.values) < cell.expected:
        ours = f"{MISSING} ({len(cell.values)} of {cell.expected})"
    rate = cell.event_rate_hz if line.width else None
    return ours, number(entry.paper), number(entry.difference, "+"), rate_label(rate)


def rate_label(event_rate_hz: float | None) -> str:
    """Event rate in Mev/s to about three digits."""
    if event_rate_hz is None or not math.isfinite(event_rate_hz):
        return MISSING
    mega = event_rate_hz / 1e6
    return f"{mega:.{0 if mega >= 100 else 1 if mega >= 10 else 2}f}"


def number_text(value: float, decimals: int, sign: str = "") -> str:
    """Format with a true minus sign, and none on a zero; `sign` "+" asks for a plus as well."""
    return f"{value:{sign}z.{decimals}f}".replace("-", "−")


# ---- the three ways to print -------------------------------------------------------------------


def to_rich(table: ComparisonTable) -> rich.console.Group:
    """Render for a terminal of 80 columns or more, each block under its own heading."""
    parts: list[rich.console.RenderableType] = [Text(table.title, "bold")]
    for block in table.blocks:
        parts += [Text(f"\n{block.scene}, {speed_label(block.scene, block.speed)}", "italic")]
        parts += [_rich_block(block, table)]
    footnote = f"\nM/s: million events a second; {table.footnote}"
    return rich.console.Group(*parts, Text(footnote, "dim"))


def _rich_block(block: Block, table: ComparisonTable) -> rich.table.Table:
    shown = rich.table.Table(box=None, padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")
    shown.add_column("", no_wrap=True)
    for cutoff_hz in table.cutoffs_hz:
        shown.add_column(cutoff_label(cutoff_hz), justify="right", no_wrap=True)
        shown.add_column("paper", justify="right", style="dim", no_wrap=True)
        shown.add_column("Δ", justify="right", no_wrap=True)
        shown.add_column("M/s", justify="right", style="dim", no_wrap=True)
    for line in block.lines:
        cells = [Text(_line_label(line, table.series))]
        for entry in line.entries:
            ours, paper, difference, rate = _texts(entry, table, line)
            cells += [
                Text(ours, "bold" if entry.best else ""),
                Text(paper, "bold" if entry.paper_best else ""),
                Text(difference),
                Text(rate),
            ]
        shown.add_row(*cells)
    return shown


def to_html(table: ComparisonTable) -> str:
    """Render as one ``<table>``, each block a ``<tbody>``."""
    groups = "".join(
        f'<th scope="colgroup" colspan="4">{html.escape(cutoff_label(c))} '
        f"<small>{html.escape(cutoff_detail(c))}</small></th>"
        for c in table.cutoffs_hz
    )
    heads = '<th scope="col">ours</th><th scope="col">paper</th><th scope="col">Δ</th>'
    heads += '<th scope="col">Mev/s</th>'
    parts = [
        f'<table class="scores"><caption><span>{html.escape(table.title)}</span></caption>',
        f'<thead><tr><th rowspan="2" scope="col">sensor</th>{groups}</tr>',
        f"<tr>{heads * len(table.cutoffs_hz)}</tr></thead>",
    ]
    for block in table.blocks:
        speed = speed_label(block.scene, block.speed)
        title = f"{html.escape(block.scene)} <small>{speed}</small>"
        span = 1 + 4 * len(table.cutoffs_hz)
        parts.append(
            f'<tbody><tr class="block"><th scope="rowgroup" colspan="{span}">'
            f"<span>{title}</span></th></tr>"
        )
        for line in block.lines:
            label = html.escape(_line_label(line, table.series))
            kind = "" if line.width else ' class="baseline"'
            cells = "".join(_html_entry(entry, table, line) for entry in line.entries)
            parts.append(f'<tr{kind}><th scope="row">{label}</th>{cells}</tr>')
        parts.append("</tbody>")
    parts.append("</table>")
    return "\n".join(parts)


def _html_entry(entry: Entry, table: ComparisonTable, line: Line) -> str:
    ours, paper, difference, rate = _texts(entry, table, line)
    ours = f"<strong>{ours}</strong>" if entry.best else ours
    paper = f"<strong>{paper}</strong>" if entry.paper_best else paper
    return (
        f'<td class="ours">{ours}</td><td class="paper">{paper}</td>'
        f'<td class="difference">{difference}</td><td class="rate">{rate}</td>'
    )


_CSV_COLUMNS = (
    *("scene", "task", "method", "metric", "width", "cutoff_hz", "speed"),
    *("samples", "expected_samples", "median", "paper", "difference", "event_rate_mev_s", "best"),
)


def to_csv(tables: Iterable[ComparisonTable]) -> str:
    """Render as tidy CSV, one line a cell; what is missing is empty."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    for table in tables:
        task, method, metric = table.series
        for block in table.blocks:
            for line in block.lines:
                for cutoff_hz, entry in zip(table.cutoffs_hz, line.entries, strict=True):
                    cell = entry.cell
                    rate = cell.event_rate_hz if line.width else None
                    numbers = (cell.median, entry.paper, entry.difference, rate and rate / 1e6)
                    writer.writerow(
                        [
                            block.scene,
                            task,
                            method if line.width else BASELINES[task],
                            metric,
                            line.width or "",
                            cutoff_hz,
                            block.speed,
                            len(cell.values),
                            cell.expected,
                            *("" if n is None else f"{n:.6g}" for n in numbers),
                            int(entry.best),
                        ]
                    )
    return file.getvalue()
