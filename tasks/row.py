"""`Row`: one tidy result line, and the CSV file that holds many of them."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from tasks.errors import ResultError
from tasks.files import write_bytes


@dataclass(frozen=True, slots=True)
class Row:
    """One score of one method on one sample under one condition.

    A do-nothing baseline is a row too, with its own `method` name, so every table can set a score
    beside the score of not using the events at all.
    """

    scene: str
    task: str  # "reconstruction", "video", "flow" or "tracking"
    method: str  # such as "event_integration"; every task has a do-nothing baseline
    width: int  # px, sensor width
    cutoff_hz: float  # photoreceptor cutoff; inf = ideal
    contrast_threshold: float  # C, log units
    speed: float  # factor on the camera's base speed
    sample: int  # index of the sample along the path
    metric: str  # "psnr_db", "rnepe_px" or "position_error_mm"
    value: float
    event_rate_hz: float  # events per second of the whole sensor, in the scored window
    variant: str = ""  # of the task, such as "61 px patch" or "sigma 2 mm"; "" is the usual one
    item: int = 0  # feature or trial within the sample
    failure: str = ""  # why the method gave up; its value is then that of its starting point

    def __post_init__(self) -> None:
        if self.width <= 0:
            raise ResultError(f"Row.width must be positive, got {self.width}")
        if not self.cutoff_hz > 0:
            raise ResultError(f"Row.cutoff_hz must be positive or inf, got {self.cutoff_hz}")
        if not (self.contrast_threshold > 0 and math.isfinite(self.contrast_threshold)):
            raise ResultError(
                f"Row.contrast_threshold must be positive, got {self.contrast_threshold}"
            )
        if not (self.speed > 0 and math.isfinite(self.speed)):
            raise ResultError(f"Row.speed must be positive, got {self.speed}")


_TYPES = {"str": str, "int": int, "float": float}
_FIELDS = {f.name: _TYPES[str(f.type)] for f in fields(Row)}


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """Write rows as CSV; the file appears under its name only when it is whole."""
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(_FIELDS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    write_bytes(path, text.getvalue().encode())


def read_rows(path: Path) -> list[Row]:
    """Read a CSV of rows.

    Raises
    ------
    ResultError
        The file is missing, a column is missing, or a cell is not of its type; the text names the
        file, the line and the field.
    """
    try:
        with path.open(newline="") as file:
            reader = csv.DictReader(file)
            missing = set(_FIELDS) - set(reader.fieldnames or ())
            if missing:
                raise ResultError(f"{path}: no column {', '.join(sorted(missing))}")
            return [_parse(path, reader.line_num, record) for record in reader]
    except FileNotFoundError:
        raise ResultError(f"{path}: no such file; is this the folder of a finished run?") from None


def _parse(path: Path, line: int, record: dict[str, str]) -> Row:
    values = {}
    for name, kind in _FIELDS.items():
        try:
            values[name] = kind(record[name])
        except (TypeError, ValueError):
            raise ResultError(
                f"{path}, line {line}, field {name}: found {record[name]!r}, "
                f"expected {kind.__name__}"
            ) from None
    return Row(**values)
