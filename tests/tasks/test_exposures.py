"""`frames.csv`: exposures are written and read as they are, and mistakes name file and line."""

import pytest

from tasks.errors import TaskError
from tasks.exposures import Exposure, read_exposures, write_exposures


def test_exposures_come_back(tmp_path):
    """Promise: times to the microsecond over the whole clock, and names with commas and quotes."""
    exposures = [Exposure(-5, 0, "a.png"), Exposure(2**62, 2**62 + 1, 'b, "left".png')]
    write_exposures(tmp_path, exposures)
    assert read_exposures(tmp_path) == exposures


def test_other_columns_and_orders_are_read(tmp_path):
    """Promise: columns go by their names, and others may stand beside them."""
    (tmp_path / "frames.csv").write_text("file,gain,t_us_end, t_us_start\na.png,2,9,4\n\n")
    assert read_exposures(tmp_path) == [Exposure(4, 9, "a.png")]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "found columns '', without t_us_start, t_us_end, file; each frame needs the start"),
        ("t_us_start,file\n1,a.png\n", "without t_us_end; each frame needs"),
        ("t_us_start,t_us_end,file\n0,1,a.png\n5,b.png\n", "frames.csv:3: found '5,b.png'"),
        ("t_us_start,t_us_end,file\n0,1.5,a.png\n", "frames.csv:2: found '0,1.5,a.png'"),
        ("t_us_start,t_us_end,file\n0,1,\n", "frames.csv:2: found '0,1,', expected the start"),
        (f"t_us_start,t_us_end,file\n0,{2**63},a.png\n", "frames.csv:2: found '0,9223372036854775"),
        ("t_us_start,t_us_end,file\n5,4,a.png\n", "frames.csv:2: found '5,4,a.png'"),
    ],
)
def test_mistakes_are_named(tmp_path, text, said):
    """Promise: a wrong table is refused with its file, its line and what it has."""
    (tmp_path / "frames.csv").write_text(text)
    with pytest.raises(TaskError) as error:
        read_exposures(tmp_path)
    assert said in str(error.value)
