"""`Row`, one score of a result table, and its Parquet files."""

from __future__ import annotations

import gc
import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eres_render.errors import check_positive, reading
from eres_render.storage.atomic import write_bytes
from sensor.growth import check_growth
from sensor.model import PHOTORECEPTORS
from tasks.errors import ResultError

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True, slots=True)
class Row:
    """One score of one method on one sample under one condition.

    A do-nothing baseline has rows too, with its own `method` name, so that tables can compare every
    score with that of not using the events.

    Examples
    --------
    >>> from tasks.row import Row
    >>> condition = dict(width=346, cutoff_hz=200.0, contrast_threshold=0.2, speed=1.0, sample=0)
    >>> row = Row(
    ...     scene="carpet",
    ...     task="reconstruction",
    ...     method="event_integration",
    ...     **condition,
    ...     metric="psnr_db",
    ...     value=17.7,
    ...     event_rate_hz=3.1e6,
    ... )
    >>> row.value, row.variant
    (17.7, '')
    """

    scene: str
    task: str  # a name in `tasks.registry.TASKS`
    method: str  # such as "event_integration"; every task has a do-nothing baseline
    width: int  # px, sensor width
    cutoff_hz: float  # photoreceptor cutoff; inf = ideal
    contrast_threshold: float  # C, log units
    speed: float  # factor on the camera's base speed
    sample: int  # index of the sample along the path
    metric: str  # "psnr_db", "rnepe_px" or "position_error_mm"
    value: float
    event_rate_hz: float  # events per second of the whole sensor in the scored window
    variant: str = ""  # of the task, such as "61 px patch" or "sigma 2 mm"; "" is the usual one
    item: int = 0  # feature or trial within the sample
    failure: str = ""  # reason for a failure; the value is then that of its start or end
    photoreceptor: str = "two_pole"  # as in `sensor.SensorModel`; arbitrary for ideal pixels
    sensor: str = ""  # name of the sensor; "" for one of the study's widths
    illuminance_lux: float = 0.0  # light on the scene; 0 if the light is given as a cutoff
    speed_m_s: float = 0.0  # mean speed of the camera; 0 if it is given as a factor
    bus_mev_s: float = math.inf  # capacity of the bus, million events per second; inf = no bus
    dropped: float = 0.0  # share of the window's events that the bus lost
    t_us: int = 0  # end of a recording's window, or time of its image; 0 on rendered clips
    simulator: str = "exact"  # or the name of an emulation, such as "v2e-A, 1 px"

    @property
    def reading(self) -> str:
        """What the pixels were simulated as: the photoreceptor, or the emulation's name."""
        return self.photoreceptor if self.simulator == "exact" else self.simulator

    def __post_init__(self) -> None:
        # One comparison for the usual row: a run has a million.
        positive = 0 < self.width < math.inf and 0 < self.contrast_threshold < math.inf
        positive = positive and 0 < self.speed < math.inf and self.cutoff_hz > 0
        if positive and self.photoreceptor in PHOTORECEPTORS:
            return
        for name in ("width", "contrast_threshold", "speed"):
            check_positive(f"Row.{name}", getattr(self, name), ResultError)
        name, expected = "cutoff_hz", "a positive number or inf"
        if self.cutoff_hz > 0:
            name, expected = "photoreceptor", " or ".join(map(repr, PHOTORECEPTORS))
        raise ResultError(f"Row.{name}: found {getattr(self, name)!r}, expected {expected}")


_ARROW_TYPES = {"str": "string", "int": "int64", "float": "double"}
_COLUMNS = {f.name: _ARROW_TYPES[str(f.type)] for f in fields(Row)}
_LATER = {field.name: field.default for field in fields(Row)[list(_COLUMNS).index("failure") + 1 :]}
"""Columns that older files lack, with their defaults: those after the failure."""


def write_rows(path: str | Path, rows: Iterable[Row]) -> None:
    """Write rows as Parquet; the file appears only when it is complete.

    Parameters
    ----------
    path
        The file.
    rows
        Its rows.
    """
    import pyarrow as pa  # here, as it would slow down `eres --help`
    import pyarrow.parquet as pq

    schema = pa.schema(
        pa.field(name, pa.type_for_alias(kind), nullable=False) for name, kind in _COLUMNS.items()
    )
    rows = list(rows)
    table = pa.table({name: [getattr(row, name) for row in rows] for name in _COLUMNS}, schema)
    data = pa.BufferOutputStream()
    pq.write_table(
        table,
        data,
        compression="zstd",
        compression_level=9,
        use_dictionary=[name for name in _COLUMNS if name != "value"],  # few values are equal
        write_page_checksum=True,
        store_schema=False,  # Parquet's own is enough
    )
    write_bytes(Path(path), data.getvalue().to_pybytes())


def read_rows(path: str | Path) -> list[Row]:
    """Read a Parquet file of rows. Columns missing from older versions get their defaults.

    Raises
    ------
    ResultError
        The file is missing, truncated or damaged, or a column is missing, unknown, not of its type
        or incomplete; the text names the file and the field.

    Examples
    --------
    >>> from tasks.row import Row, read_rows, write_rows
    >>> condition = dict(width=346, cutoff_hz=200.0, contrast_threshold=0.2, speed=1.0, sample=0)
    >>> score = dict(metric="psnr_db", value=17.7, event_rate_hz=3.1e6)
    >>> row = Row("carpet", "reconstruction", "event_integration", **condition, **score)
    >>> write_rows("rows.parquet", [row])
    >>> read_rows("rows.parquet") == [row]
    True
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = Path(path)
    if not path.exists():
        raise ResultError(f"{path}: no such file; is this the folder of a finished run?")
    with reading(path, "a Parquet file of rows", ResultError):
        data = path.read_bytes()
        file = pq.ParquetFile(pa.BufferReader(data), page_checksum_verification=True)
        check_growth(8 * file.metadata.num_rows * file.metadata.num_columns, len(data))
        table = file.read()
        table.validate(full=True)
    _check_columns(path, table)
    columns = [
        _plain(table[name]) if name in table.column_names else [_LATER[name]] * len(table)
        for name in _COLUMNS
    ]
    collects = gc.isenabled()
    gc.disable()  # rows have no cycles, and looking for some in a million takes as long as all else
    try:
        rows = [object.__new__(Row) for _ in range(len(table))]
        # Column by column, as a frozen row's own __init__ would take twice as long as all else.
        for name, column in zip(_COLUMNS, columns, strict=True):
            deque(map(getattr(Row, name).__set__, rows, column), maxlen=0)
        for k, row in enumerate(rows):
            try:
                row.__post_init__()
            except ResultError as error:
                raise ResultError(f"{path}, row {k}: {error}") from None
    finally:
        if collects:
            gc.enable()
    return rows


def _plain(column: pa.ChunkedArray) -> list[str | int | float]:
    """Return the values of a column; equal ones are one object, as most of a million are."""
    coded = column.combine_chunks().dictionary_encode()
    known = np.empty(len(coded.dictionary), object)
    known[:] = coded.dictionary.to_pylist()
    values: list[str | int | float] = known[coded.indices.to_numpy()].tolist()
    return values


def _check_columns(path: Path, table: pa.Table) -> None:
    types = {field.name: str(field.type) for field in table.schema}
    for name in _COLUMNS | types:
        value, expected = (kinds.get(name, "no such column") for kinds in (types, _COLUMNS))
        if value == expected and (nulls := table[name].null_count):
            value, expected = f"{nulls} of {len(table)} rows without a value", "none"
        if value != expected and not (name in _LATER and name not in types):
            raise ResultError(f"{path}, field {name}: found {value}, expected {expected}")
