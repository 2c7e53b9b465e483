"""docs/notebooks/events.ipynb runs from top to bottom."""

import json
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from sensor import Events

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebooks" / "events.ipynb"


@pytest.mark.slow
def test_the_notebook_runs(tmp_path, monkeypatch):
    """Promise: each cell runs after the one before, and the last image is of five bins."""
    mpl.use("agg")
    monkeypatch.chdir(tmp_path)
    names = {}
    for cell in json.loads(NOTEBOOK.read_text())["cells"]:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    names["plt"].close("all")
    assert names["voxels"].shape == (5, 260, 346)
    assert len(names["events"]) > len(names["dim"]) > 0


@pytest.mark.parametrize("size", [(3, 2), (1280, 720)])
def test_events_show_themselves(size):
    """Promise: in a notebook events are a line and a picture, and none are a line."""

    def events(*rows):
        kinds = (np.int64, np.uint16, np.uint16, np.int8)
        columns = zip(*rows, strict=True) if rows else ((), (), (), ())
        return Events(*map(np.array, columns, kinds), *size)

    none, one = events(), events((7, 1, 1, -1))
    assert "<img" not in none._repr_html_()
    assert f"0 of {size[0]}x{size[1]} px" in none._repr_html_()
    assert one._repr_html_().count("data:image/png;base64,") == 1
    assert "1 events in 0 ms from 7 us" in one._repr_html_()
