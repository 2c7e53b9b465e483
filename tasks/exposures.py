"""`frames.csv`: the exposures of a frame camera's images, on the clock of the events."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eres_render.errors import reading
from eres_render.storage.atomic import write_text
from tasks.errors import TaskError

FILE_NAME = "frames.csv"
COLUMNS = ("t_us_start", "t_us_end", "file")


class Exposure(NamedTuple):
    """Start and end of an exposure, microseconds, and the name of its image."""

    start_us: int
    end_us: int
    file: str

    @property
    def t_us(self) -> int:
        """The middle of the exposure, microseconds."""
        return (self.start_us + self.end_us) // 2


def write_exposures(folder: Path, exposures: Iterable[Exposure]) -> None:
    """Write frames.csv into a folder."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *exposures])
    write_text(folder / FILE_NAME, text.getvalue())


def read_exposures(folder: Path) -> list[Exposure]:
    """Read frames.csv; columns besides its own are ignored."""
    path = folder / FILE_NAME
    with (
        reading(path, "CSV", TaskError),
        path.open(newline="", encoding="utf-8-sig", errors="replace") as file,
    ):
        table = csv.reader(file)
        names = [name.strip() for name in next(table, [])]
        if missing := [name for name in COLUMNS if name not in names]:
            raise TaskError(
                f"{path}: found columns {','.join(names)!r}, without {', '.join(missing)}; each "
                "frame needs the start and the end of its exposure"
            )
        places = [names.index(name) for name in COLUMNS]
        return [_exposure(f"{path}:{table.line_num}", row, places) for row in table if row]


def _exposure(where: str, row: list[str], places: list[int]) -> Exposure:
    with suppress(ValueError, IndexError, OverflowError):
        first, last, name = (row[place].strip() for place in places)
        start_us, end_us = (int(np.int64(int(time))) for time in (first, last))
        if name and start_us <= end_us:
            return Exposure(start_us, end_us, name)
    raise TaskError(
        f"{where}: found {','.join(row)!r}, expected the start and the end of an exposure in whole "
        "microseconds, and a file"
    )
