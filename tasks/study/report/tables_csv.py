"""Write comparison tables as tidy CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

from tasks.study.results.asked import MetersPerSecond, Series, lux_of
from tasks.study.results.comparison import Block, ComparisonTable, Entry, Line, native_px

_CSV_COLUMNS = (
    *("scene", "task", "method", "variant", "metric"),
    *("width", "sensor", "cutoff_hz", "illuminance_lux", "contrast_threshold"),
    *("speed", "speed_m_s"),
    *("values", "expected_values", "median", "paper", "difference", "event_rate_mev_s", "best"),
    *("native_px", "failure_share", "beats_nothing", "effective_samples"),
)


def to_csv(tables: Iterable[ComparisonTable]) -> str:
    """Render tables as tidy CSV, one line per cell; missing values are empty.

    `speed` is a factor on the base speed. It is empty where the study gives m/s, and
    `illuminance_lux` where it does not give lux.

    A camera with a contrast threshold of its own is in the tables of all thresholds, and doing
    nothing in those of all methods of a task; each is written with the first. `cutoff_hz` is empty
    for a camera in a light that is given in lux: its own cutoff is in rows.parquet.
    `effective_samples` is how many independent samples those of the median are worth.
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
    numbers = [cell.median, entry.paper, entry.difference, None if line.nothing else rate]
    numbers += [native_px(cell.median, line, series), None if line.nothing else cell.failure_share]
    numbers.append(cell.effective_samples)
    texts = ["" if number is None else f"{number:.6g}" for number in numbers]
    return [
        *(block.scene, series.task, series.method, series.variant, series.metric),
        *(width, sensor),
        "" if sensor and lux_of(cutoff_hz) else cutoff_hz,
        lux_of(cutoff_hz) or "",
        line.contrast_threshold,
        *(("", block.speed) if isinstance(block.speed, MetersPerSecond) else (block.speed, "")),
        *(len(cell.values), cell.expected),
        *texts[:4],
        int("bold" in entry.marks.get("ours", "")),
        *texts[4:6],
        "" if entry.beats_nothing is None else int(entry.beats_nothing),
        texts[6],
    ]
