"""Rows in Parquet: no loss, nothing but rows, and errors that name damage."""

import math
import random
from dataclasses import replace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from study_rows import EPPT, nothing_rows, paper_rows
from tasks.errors import ResultError
from tasks.row import read_rows, write_rows


@pytest.fixture(scope="module")
def rows():
    scored = [
        replace(r, failure="left its square, at 2 °") if r.width == 240 else r
        for r in paper_rows(EPPT, samples=1, scenes=["carpet"])
    ]
    return scored + nothing_rows(scored, math.nextafter(1, 2))


@pytest.fixture
def file(rows, tmp_path):
    write_rows(tmp_path / "rows.parquet", rows)
    return tmp_path / "rows.parquet"


def test_rows_come_back_bit_for_bit(rows, file):
    """Promise: every float, inf too, text and count survives; a file without rows is valid."""
    assert read_rows(file) == rows
    assert any(math.isinf(r.cutoff_hz) for r in rows)
    write_rows(file, [])
    assert read_rows(file) == []


def test_others_read_the_columns_by_name(rows, file):
    """Promise: a table of plain columns, as docs/study_run.md lists them."""
    table = pq.read_table(file)
    assert table["value"].to_pylist() == [r.value for r in rows]
    assert table["failure"].to_pylist() == [r.failure for r in rows]
    assert {str(f.type) for f in table.schema} == {"string", "int64", "double"}


def test_what_is_not_rows_is_refused_by_name(file):
    """Promise: the error has file, field, found and expected, also for a number that no row can
    have."""
    table = pq.read_table(file)
    width = table.schema.get_field_index("width")
    some = pa.array([None, *table["value"].to_pylist()[1:]], pa.float64())

    def refusal(changed):
        pq.write_table(changed, file)
        with pytest.raises(ResultError) as refused:
            read_rows(file)
        return str(refused.value).removeprefix(str(file))

    narrow = table.set_column(width, "width", table["width"].cast("int16"))
    assert refusal(narrow) == ", field width: found int16, expected int64"
    missing = table.drop_columns(["metric"])
    assert refusal(missing) == ", field metric: found no such column, expected string"
    more = table.append_column("color", table["scene"])
    assert refusal(more) == ", field color: found string, expected no such column"
    holes = table.set_column(table.schema.get_field_index("value"), "value", some)
    assert (
        refusal(holes)
        == f", field value: found 1 of {len(table)} rows without a value, expected none"
    )
    zero = table.set_column(width, "width", pa.array([346, *[0] * (len(table) - 1)]))
    assert refusal(zero) == ", row 1: Row.width: found 0, expected a positive number"
    file.unlink()
    with pytest.raises(ResultError, match="no such file"):
        read_rows(file)


def test_damage_is_named(rows, file):
    """Promise: the reader refuses a truncated file; with a flipped bit it refuses it or is
    correct."""
    whole = file.read_bytes()
    rng = random.Random(5)
    for size in [0, 1, len(whole) - 1, *rng.sample(range(len(whole)), 80)]:
        file.write_bytes(whole[:size])
        with pytest.raises(ResultError, match=r"rows\.parquet: could not be read as a Parquet"):
            read_rows(file)
    refused = 0
    for where in rng.sample(range(len(whole)), 240):
        damaged = bytearray(whole)
        damaged[where] ^= 1 << rng.randrange(8)
        file.write_bytes(damaged)
        try:
            found = read_rows(file)
        except ResultError as error:
            refused += str(error).startswith(str(file))
        else:
            assert found == rows
    assert refused > 120  # the rest lies in what no reader needs, such as statistics


def test_rows_of_an_older_version_have_the_defaults_of_later_columns(rows, file):
    """Promise: a finished run stays readable; its sensors are squares with two poles, without a
    bus."""
    later = [
        "photoreceptor",
        "sensor",
        "illuminance_lux",
        "speed_m_s",
        "bus_mev_s",
        "dropped",
        "t_us",
    ]
    pq.write_table(pq.read_table(file).drop_columns(later), file)
    found = read_rows(file)
    assert found == rows
    assert {row.photoreceptor for row in found} == {"two_pole"}
