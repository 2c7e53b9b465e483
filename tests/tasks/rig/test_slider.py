"""The slider: strokes, readings, gaps and clocks."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sensor import Events
from tasks.errors import RigError
from tasks.rig.detect import _frames
from tasks.rig.evaluate import RigEvaluation, _windows
from tasks.rig.settings import SliderSettings
from tasks.rig.slider import Slider, read_slider, strokes, write_slider

SETTINGS = SliderSettings(travel_m=0.2, speeds_mps=(0.2, 0.4), acceleration_mps2=10.0, pause_s=0.05)


def test_strokes_go_there_and_back_at_each_speed():
    """Promise: full travel, its ends at rest, each speed in both directions, no jump in speed."""
    slider = strokes(SETTINGS)
    assert slider.x_m.min() == pytest.approx(0.0, abs=1e-12)
    assert slider.x_m.max() == pytest.approx(0.2, abs=1e-12)
    assert slider.x_m[-1] == pytest.approx(0.0, abs=1e-12)
    # a stroke lasts travel / speed + speed / acceleration
    lasts_s = 5 * 0.05 + 2 * (0.2 / 0.2 + 0.02) + 2 * (0.2 / 0.4 + 0.04)
    assert slider.t_us[-1] == pytest.approx(1e6 * lasts_s, abs=1)
    speed = np.diff(slider.x_m) / np.diff(slider.t_us) * 1e6
    assert speed.max() == pytest.approx(0.4, rel=1e-3)
    assert speed.min() == pytest.approx(-0.4, rel=1e-3)
    assert np.abs(np.diff(speed)).max() < 10.0 * 1.1e-3
    assert np.array_equal(slider.t_us, np.round(slider.t_us))


def test_images_are_evenly_spaced_along_the_way():
    slider = strokes(SETTINGS)
    t_us = slider.evenly_along(16, 0.0, slider.t_us[-1])
    speed = slider.speed_mps(t_us)
    assert (np.sum(speed > 0), np.sum(speed < 0)) == (8, 8)
    way = np.interp(t_us, slider.t_us[1:], np.cumsum(np.abs(np.diff(slider.x_m))))
    assert np.allclose(way, (np.arange(16) + 0.5) / 16 * 0.8, atol=2e-3)
    slow = slider.evenly_along(16, 0.0, slider.t_us[-1], max_speed_mps=0.25)
    assert np.abs(slider.speed_mps(slow)).max() <= 0.25
    with pytest.raises(RigError, match=r"no motion .* of at most 1e-06 m/s"):
        slider.evenly_along(4, 0.0, 40_000.0, max_speed_mps=1e-6)


def test_no_window_is_in_a_pause():
    """Promise: with any number of windows; the middle of the way there and back is a pause."""
    slider = Slider(np.array([0, 1e6, 2e6 + 0.4, 3e6 + 0.4]), np.array([0, 0.2, 0.2, 0.0]))
    t_us, x = np.arange(0, 3_000_001, 1000), np.zeros(3001, np.uint16)
    events = Events(t_us, x, x, np.ones(3001, np.int8), width=1, height=1)
    for count in (2, 5, 10, 11):
        found = _windows(slider, events, RigEvaluation(windows=count))
        assert len(found) == count - count % 2
        assert all(abs(slider.speed_mps(0.5 * (w.start_us + w.end_us))) > 0.1 for w in found)


def events_until(t_us):
    """Return an event in each millisecond."""
    t_us = np.arange(0, t_us + 1, 1000)
    x = np.zeros(len(t_us), np.uint16)
    return Events(t_us, x, x, np.ones(len(t_us), np.int8), width=1, height=1)


def test_windows_there_and_back_share_their_places():
    """Promise: 5 places, 40 mm apart, are visited twice at each of two speeds."""
    slider = strokes(SETTINGS)
    found = _windows(slider, events_until(int(slider.t_us[-1])), RigEvaluation(windows=20))
    assert len(found) > 16
    middles_mm = {}
    for window in found:
        middles_mm.setdefault(window.place, []).append(500 * sum(window.x_m))
    assert all(np.ptp(at) < 6 for at in middles_mm.values())
    assert len(middles_mm) == 5
    assert sorted(middles_mm) == list(range(len(middles_mm)))


@pytest.mark.parametrize("step_m", [5e-6, 13e-6])
def test_windows_have_the_travel_though_the_encoder_has_steps(step_m):
    """Promise: the travel of a window is that which was asked for, to two steps of the encoder."""
    t_us = np.arange(0.0, 1e6, 500.0)
    slider = Slider(t_us, np.round(0.21e-6 * t_us / step_m) * step_m)
    found = _windows(slider, events_until(999_000), RigEvaluation(windows=20))
    assert len(found) > 5
    for window in found:
        assert abs(window.x_m[1] - window.x_m[0]) == pytest.approx(0.006, abs=2 * step_m)


def test_a_window_has_one_speed_from_its_start_to_its_end():
    """Promise: a stroke shorter than a window, whose motion is symmetric about its middle, has
    none."""
    t_us = np.arange(0.0, 2e5, 1000.0)
    speed = np.interp(t_us, [5e4, 6e4, 8e4, 9e4], [0.0, 0.2, 0.2, 0.0])
    slider = Slider(t_us, np.concatenate([[0.0], np.cumsum(speed[1:] * 1e-3)]))
    assert 0.0055 < slider.x_m[-1] < 0.0065
    with pytest.raises(RigError, match="found no window of constant speed"):
        _windows(slider, events_until(199_000), RigEvaluation(windows=9))


def test_windows_that_pass_the_ends_of_the_readings_are_left_out():
    """Promise: they are not a reason to score none of the others."""
    t_us = np.arange(0.0, 3e5, 500.0)
    slider = Slider(t_us, 0.2e-6 * t_us)
    found = _windows(slider, events_until(299_000), RigEvaluation(windows=60, travel_m=0.01))
    assert 40 < len(found) < 60


def test_a_file_of_a_spreadsheet_begins_with_a_byte_order_mark(tmp_path):
    (tmp_path / "slider.csv").write_text("t_us,x_m\n0,0\n5,1\n", encoding="utf-8-sig")
    assert read_slider(tmp_path / "slider.csv").x_m.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("interval_us", [None, 0.3])
def test_files_keep_every_digit(tmp_path, interval_us):
    """Promise: what is written is read again, also with several readings in a microsecond."""
    slider = strokes(SETTINGS)
    if interval_us:
        slider = Slider(interval_us * np.arange(len(slider.x_m)), slider.x_m)
    write_slider(tmp_path / "slider.csv", slider)
    back = read_slider(tmp_path / "slider.csv")
    assert np.array_equal(back.t_us, slider.t_us)
    assert np.array_equal(back.x_m, slider.x_m)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t_us,x_m\n0,0\n", "found 1 readings"),
        ("t_us\n0\n1\n", "x_m: no such column"),
        ("t_us,x_m\n0,0\n5,\n", "line 3: x_m: found no value"),
        ("t_us,x_m\n0,0\n5,a\n", "could not convert"),
        ("t_us,x_m\n0,0\n5,nan\n", "not finite"),
        ("t_us,x_m\n5,0\n0,1\n", "expected increasing times"),
        (
            "t_us,x_m\n" + "".join(f"{t},{t * 1e-6}\n" for t in [*range(50), *range(500, 550)]),
            "found no reading from 49 to 500 us while it moved",
        ),
    ],
)
def test_wrong_readings_are_refused(tmp_path, text, expected):
    file = tmp_path / "slider.csv"
    file.write_text(text)
    with pytest.raises(RigError, match=expected) as refused:
        read_slider(file)
    assert "slider.csv" in str(refused.value)


def test_a_rest_without_readings_is_no_gap():
    """Promise: an encoder that only reports motion is fine."""
    moving = np.arange(100.0)
    t = np.concatenate([moving, 10_000 + moving])
    x = np.concatenate([moving, 99 + moving])
    Slider(t, x).check_gaps()


def test_times_without_readings_are_refused():
    slider = Slider(np.array([0.0, 100.0]), np.array([0.0, 1.0]))
    assert slider.position_m([50.0]).tolist() == [0.5]
    with pytest.raises(RigError, match="do the two clocks agree"):
        slider.position_m([101.0])


def test_frames_are_those_of_slow_motion():
    """Promise: with a limit, no frame of a faster stroke is used, however near to a slow time."""
    slider = strokes(SETTINGS)
    taken_us = slider.evenly_along(40, 0.0, slider.t_us[-1])  # as `eres rig render` takes them
    frames = tuple(SimpleNamespace(t_us=int(t_us), codes=lambda camera: None) for t_us in taken_us)
    recording = SimpleNamespace(slider=slider, frames=frames, camera=None, folder=Path("near"))
    for limit, fastest in ((0.25, 0.2), (np.inf, 0.4)):
        used_us = [t_us for t_us, _ in _frames(recording, 40, limit)]
        assert np.abs(slider.speed_mps(np.array(used_us))).max() == pytest.approx(fastest, rel=1e-3)
    with pytest.raises(RigError, match=r"no frame at which the slider has 0\.01 m/s"):
        list(_frames(recording, 40, 0.01))


@pytest.mark.parametrize("step_m", [1e-6, 5e-6])
def test_an_encoder_may_log_its_steps_alone(step_m):
    """Promise: a turn without readings is no gap, as the carriage rests; one in a stroke is."""
    slider = strokes(SETTINGS)
    t_us = np.arange(slider.t_us[0], slider.t_us[-1], 1.0)
    x_m = np.round(slider.position_m(t_us) / step_m) * step_m
    logged = np.flatnonzero(np.diff(x_m, append=np.inf))
    Slider(t_us[logged], x_m[logged]).check_gaps()
    kept = logged[(t_us[logged] < 3e5) | (t_us[logged] > 4e5)]
    with pytest.raises(RigError, match=r"no reading from 29.* to 40.* us while it moved"):
        Slider(t_us[kept], x_m[kept]).check_gaps()
