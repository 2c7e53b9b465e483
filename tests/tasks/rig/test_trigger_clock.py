"""The clocks of the slider and of the events, from edges that both recorded."""

import numpy as np
import pytest

from sensor.formats import Triggers
from sensor.formats.triggers import NO_TRIGGERS
from tasks.errors import RigError
from tasks.rig.recording import on_clock_of_events
from tasks.rig.slider import Slider

SLIDER = Slider(np.linspace(0.0, 1e6, 11), np.linspace(0.0, 0.2, 11))
DRIFT, ZERO_US = 4e-5, 7_000_123.0
EDGES_US = np.array([5_000.0, 300_000.0, 610_000.0, 990_000.0])


def on_events(t_us):
    return ZERO_US + (1 + DRIFT) * t_us


def never():
    raise AssertionError("the file of events is not needed")


def written(tmp_path, lines, header="slider_us,t_us"):
    file = tmp_path / "triggers.csv"
    file.write_text("\n".join([header, *lines]) + "\n")
    return file


def test_edges_give_offset_and_drift(tmp_path):
    """Analytic: exact edges give the relation of the clocks, to rounding; positions stay."""
    both = zip(EDGES_US.tolist(), on_events(EDGES_US).tolist(), strict=True)
    pairs = [f"{one!r},{two!r}" for one, two in both]
    found = on_clock_of_events(SLIDER, written(tmp_path, pairs), never)
    assert found.t_us == pytest.approx(on_events(SLIDER.t_us), abs=1e-3)
    assert np.array_equal(found.x_m, SLIDER.x_m)


def test_edges_of_the_file_of_events(tmp_path):
    """Promise: without `t_us`, the rising edges in order; one edge gives the offset."""
    up_us = np.round(on_events(EDGES_US)).astype(np.int64)
    both = np.sort(np.concatenate([up_us, up_us + 50]))
    edges = Triggers(both, np.zeros(8, np.uint8), np.tile([1, -1], 4).astype(np.int8))
    file = written(tmp_path, EDGES_US.astype(int).astype(str).tolist(), "slider_us")
    found = on_clock_of_events(SLIDER, file, lambda: edges)
    assert found.t_us == pytest.approx(on_events(SLIDER.t_us), abs=1.5)
    one = on_clock_of_events(SLIDER, written(tmp_path, ["5000,7005123"]), never)
    assert one.t_us == pytest.approx(SLIDER.t_us + 7_000_123)


def test_edges_close_together_give_no_drift(tmp_path):
    """Promise: a contact that bounces by a microsecond within 2 ms says nothing of a second."""
    found = on_clock_of_events(SLIDER, written(tmp_path, ["0,1000000", "2000,1002001"]), never)
    assert found.t_us == pytest.approx(SLIDER.t_us + 1_000_000.5)


def test_edges_on_several_channels_are_refused(tmp_path):
    """Promise: edges of a camera's clock are not taken for those of the slider."""
    edges = Triggers(np.arange(4), np.array([0, 1] * 2, np.uint8), np.ones(4, np.int8))
    file = written(tmp_path, ["5000", "300000"], "slider_us")
    with pytest.raises(RigError, match=r"triggers.csv: triggers: found edges on channels 0, 1;"):
        on_clock_of_events(SLIDER, file, lambda: edges)


@pytest.mark.parametrize(
    ("header", "lines", "expected"),
    [
        ("t_us", ["1"], "no column slider_us"),
        ("slider_us,t_us", ["1,a"], "could not convert"),
        ("slider_us,t_us", [], "has 0 edges"),
        ("slider_us", ["1", "2"], "has 2 edges of the slider, .* 0 rising"),
        ("slider_us,t_us", ["0,0", "1000,5000", "900000,900000"], "by 2002 us .limit 1000"),
        ("slider_us,t_us", ["0,0", "1000000,1100000"], "a clock drift of 0.1"),
    ],
)
def test_edges_that_do_not_fit_are_refused(tmp_path, header, lines, expected):
    with pytest.raises(RigError, match=expected):
        on_clock_of_events(SLIDER, written(tmp_path, lines, header), lambda: NO_TRIGGERS)
