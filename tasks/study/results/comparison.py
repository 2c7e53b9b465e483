"""Compare median scores with the paper's, condition by condition; the tables as tidy CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from tasks.study.results.asked import MetersPerSecond, SensorId, Series, lux_of
from tasks.study.results.cells import Cell
from tasks.study.results.choice import Pick, pick
from tasks.study.results.paper import CONTRAST_THRESHOLD, source
from tasks.study.results.perturbation import is_main, shown_series
from tasks.study.results.scores import Scores, base_speed, beats
from tasks.study.results.words import MISSING, capitalized, rate_label, share_text

_CSV_COLUMNS = (
    *("scene", "task", "method", "variant", "metric"),
    *("width", "sensor", "cutoff_hz", "illuminance_lux", "contrast_threshold"),
    *("speed", "speed_m_s"),
    *("values", "expected_values", "median", "paper", "difference", "event_rate_mev_s", "best"),
    *("native_px", "failure_share", "beats_nothing", "effective_samples"),
)


@dataclass(frozen=True, slots=True)
class Entry:
    """Our median and the paper's in one place of a table.

    `marks` of the columns "ours" and "paper" are "bold" for the best sensor, "underline" for the
    smallest that is enough, as in `Pick`, and "strike" if doing nothing is as good. Bold and
    underline need all sensors. `beats_nothing` is None if either median is missing.
    """

    cell: Cell
    paper: float | None = None
    marks: Mapping[str, str] = field(default_factory=dict)
    beats_nothing: bool | None = None

    @property
    def difference(self) -> float | None:
        """Return our median minus the paper's, or None if either is missing."""
        if self.cell.median is None or self.paper is None:
            return None
        return self.cell.median - self.paper


@dataclass(frozen=True, slots=True)
class Line:
    """A sensor across the cutoffs; `sensor` is None if doing nothing scores the same with each."""

    sensor: SensorId | None
    entries: Sequence[Entry]
    contrast_threshold: float  # a camera may have its own
    nothing: bool = False


@dataclass(frozen=True, slots=True)
class Block:
    """All sensors on one scene at one speed; the last lines are those of doing nothing."""

    scene: str
    speed: float
    lines: tuple[Line, ...]


@dataclass(frozen=True, slots=True)
class Column:
    """A column; every cutoff has the same columns."""

    head: str
    kind: str  # "ours", "paper", "difference" or "rate"
    text: Callable[[Series, Entry, Line], str]
    meaning: str = ""  # for the footnote
    in_terminal: bool = True  # a terminal of 80 columns lacks room for all columns


@dataclass(frozen=True, slots=True)
class ComparisonTable:
    """Our medians and the paper's. Rows: scene x speed x sensor; columns: cutoffs."""

    scores: Scores
    series: Series
    cutoffs_hz: tuple[float, ...]
    blocks: tuple[Block, ...]

    @property
    def title(self) -> str:
        """Return the title with metric, unit and the better direction."""
        metric = self.series.spec.metric
        return f"{capitalized(self.series.title)}: median {metric.heading}"

    @property
    def source(self) -> str | None:
        """Return the name of the paper's table; None if it lacks these sensors and scenes."""
        lines = [line for block in self.blocks for line in block.lines]
        if all(entry.paper is None for line in lines for entry in line.entries):
            return None
        return source(self.series.task, self.series.method, [block.speed for block in self.blocks])

    def footnote(self, columns: Iterable[Column]) -> str:
        """Return the explanation of the columns that are shown, and of marks."""
        label, threshold = self.source, self.scores.contrast_threshold
        paper = f"paper: its {label}; Δ: ours minus the paper's; " if label else ""
        if self.scores.asks_as_paper and threshold != CONTRAST_THRESHOLD:
            paper = f"not in the paper at a contrast threshold of {threshold:g}; "
        notes = "".join(
            f"{column.head}: {column.meaning}; " for column in columns if column.meaning
        )
        near = self.series.spec.metric.near
        return (
            f"{paper}bold: best of the column; underlined: the smallest within {near} of "
            f"it; struck out: no better than doing nothing; {notes}"
            f"{MISSING}: not measured, or samples are missing (n of N)"
        )

    @property
    def columns(self) -> list[Column]:
        """Return the columns of every cutoff."""
        share = self.series.spec.share_column
        columns = [Column("ours", "ours", _ours)]
        if self.source is not None:
            columns += [Column("paper", "paper", lambda s, e, _: _number(s, e.paper))]
            columns += [Column("Δ", "difference", lambda s, e, _: _number(s, e.difference, "+"))]
        if self.series.spec.metric.reference_width_px is not None:
            columns += [Column("native px", "rate", _native, "pixels of the sensor", False)]
        if share is not None:
            columns += [Column(share.head, "rate", _share, share.meaning)]
        return [*columns, Column("M/s", "rate", _rate, "million events per second", share is None)]


def main_tables(scores: Scores) -> list[ComparisonTable]:
    """Compare main methods at base speed, as in Tables 2 and 3 of the paper."""
    return [
        comparison_table(scores, series, [base_speed(scores, series)])
        for series in shown_series(scores)
        if is_main(series)
    ]


def comparison_table(
    scores: Scores, series: Series, speeds: Collection[float] | None = None
) -> ComparisonTable:
    """Compare our medians with the paper's.

    `speeds` are factors on the base speed; [1.0] gives the layout of the paper's Table 2, all
    speeds the layout of its appendix.
    """
    cutoffs_hz = tuple(scores.cutoffs_hz(series))
    blocks = tuple(
        _block(scores, series, scene, speed, cutoffs_hz)
        for scene in scores.scenes(series)
        for speed in scores.speeds(series, scene)
        if speeds is None or speed in speeds
    )
    return ComparisonTable(scores, series, cutoffs_hz, blocks)


def _block(
    scores: Scores, series: Series, scene: str, speed: float, cutoffs_hz: tuple[float, ...]
) -> Block:
    sensors, metric = scores.sensors(series, scene), series.spec.metric
    ours: dict[SensorId, list[Entry]] = {sensor: [] for sensor in sensors}
    idle: dict[SensorId, list[Entry]] = {sensor: [] for sensor in sensors}
    for cutoff_hz in cutoffs_hz:
        places = {s: s.at(scene, cutoff_hz, speed) for s in sensors}
        cells = {sensor: scores.cell(series, at) for sensor, at in places.items()}
        nothing = {sensor: scores.baseline(series, at) for sensor, at in places.items()}
        paper = {sensor: scores.published(series, at) for sensor, at in places.items()}
        medians, idle_medians = ({s: c.median for s, c in of.items()} for of in (cells, nothing))
        picked, papers = pick(medians, idle_medians, metric), pick(paper, {}, metric)
        for s in sensors:
            beaten = beats(cells[s], nothing[s], series)
            marks = {"ours": _marks(s, picked, beaten is False), "paper": _marks(s, papers)}
            ours[s].append(Entry(cells[s], paper[s], marks, beaten))
            idle[s].append(Entry(nothing[s]))
    of_each = scores.contrast_thresholds
    lines = [Line(s, entries, of_each[s]) for s, entries in ours.items()]
    idle_lines = [Line(s, entries, of_each[s], nothing=True) for s, entries in idle.items()]
    if all(map(_same, zip(*idle.values(), strict=True))):
        idle_lines = [Line(None, idle[sensors[0]], scores.contrast_threshold, nothing=True)]
    return Block(scene, speed, (*lines, *idle_lines))


def _same(entries: Sequence[Entry]) -> bool:
    numbers = [entry.cell.median for entry in entries if entry.cell.median is not None]
    close = all(math.isclose(value, numbers[0], rel_tol=1e-6) for value in numbers)
    return close and len(numbers) in (0, len(entries))


def _marks(sensor: SensorId, picked: Pick | None, idle: bool = False) -> str:
    best = picked is not None and sensor == picked.best
    enough = picked is not None and picked.worthwhile and sensor == picked.enough
    return " ".join(["bold"] * best + ["underline"] * enough + ["strike"] * idle)


def _number(series: Series, value: float | None, sign: str = "") -> str:
    return MISSING if value is None else series.spec.metric.text(value, sign)


def _ours(series: Series, entry: Entry, line: Line) -> str:
    cell = entry.cell
    if 0 < len(cell.values) < cell.expected:
        return f"{MISSING} ({len(cell.values)} of {cell.expected})"
    return _number(series, cell.median)


def _native(series: Series, entry: Entry, line: Line) -> str:
    return "" if line.sensor is None else _number(series, native_px(entry, line, series))


def _share(series: Series, entry: Entry, line: Line) -> str:
    failed, column = entry.cell.failure_share, series.spec.share_column
    if line.nothing:
        return ""
    if failed is not None and column is not None and column.of_successes:
        failed = 1 - failed
    return share_text(failed).replace("\u202f", "")


def _rate(series: Series, entry: Entry, line: Line) -> str:
    return rate_label(None if line.nothing else entry.cell.event_rate_hz)


def native_px(entry: Entry, line: Line, series: Series) -> float | None:
    """Convert a median score to px of the sensor; None if it is missing or not in px."""
    median, reference_px = entry.cell.median, series.spec.metric.reference_width_px
    if median is None or line.sensor is None or reference_px is None:
        return None
    return median * line.sensor.width / reference_px


def line_label(line: Line, series: Series) -> str:
    """Name a line of a table by its sensor, or by the do-nothing method."""
    parts = [series.spec.label(series.spec.baseline)] if line.nothing else []
    if line.sensor is not None:
        parts += [*filter(None, [line.sensor.name]), f"{line.sensor.width} px"]
    return ", ".join(parts)


def to_csv(tables: Iterable[ComparisonTable]) -> str:
    """Render tables as tidy CSV, one line per cell; missing values are empty.

    `speed` is empty where the study gives m/s, and `illuminance_lux` where it does not give lux.
    `cutoff_hz` is empty for a camera in a light in lux: its own cutoff is in rows.parquet. A camera
    with a contrast threshold of its own is in the tables of all thresholds, and doing nothing in
    the tables of all methods of a task; each is written with the first.
    """
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    written = set()
    for table in tables:
        for block in table.blocks:
            for line in block.lines:
                method = table.series.spec.baseline if line.nothing else table.series.method
                series = table.series._replace(method=method)
                place = series, block.scene, block.speed, line.sensor, line.contrast_threshold
                if place in written:
                    continue
                written.add(place)
                for cutoff_hz, entry in zip(table.cutoffs_hz, line.entries, strict=True):
                    writer.writerow(_csv_line(series, block, line, cutoff_hz, entry))
    return file.getvalue()


def _csv_line(
    series: Series, block: Block, line: Line, cutoff_hz: float, entry: Entry
) -> list[str | int | float]:
    cell, (width, sensor) = entry.cell, line.sensor or ("", "")
    rate = cell.event_rate_hz and cell.event_rate_hz / 1e6
    rate, failed = (None, None) if line.nothing else (rate, cell.failure_share)
    return [
        *(block.scene, series.task, series.method, series.variant, series.metric),
        *(width, sensor),
        "" if sensor and lux_of(cutoff_hz) else cutoff_hz,
        lux_of(cutoff_hz) or "",
        line.contrast_threshold,
        *(("", block.speed) if isinstance(block.speed, MetersPerSecond) else (block.speed, "")),
        *(len(cell.values), cell.expected),
        *map(_digits, (cell.median, entry.paper, entry.difference, rate)),
        int("bold" in entry.marks.get("ours", "")),
        *map(_digits, (native_px(entry, line, series), failed)),
        "" if entry.beats_nothing is None else int(entry.beats_nothing),
        _digits(cell.effective_samples),
    ]


def _digits(number: float | None) -> str:
    return "" if number is None else f"{number:.6g}"
