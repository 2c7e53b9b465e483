"""The slider: strokes, readings, gaps and clocks."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tasks.errors import RigError
from tasks.rig.markers import _frames
from tasks.rig.prints import Way
from tasks.rig.settings import SliderSettings
from tasks.rig.slider import Slider, read_slider, slider_text, strokes

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
    with pytest.raises(RigError, match=r"no motion .* 1e-06"):
        slider.evenly_along(4, 0.0, 40_000.0, max_speed_mps=1e-6)


def way_of(slider, first_us=0, last_us=10**12, *, scale=1.0, begin_m=0.0, slope=1.0):
    """Return the way of a crop whose middle is at the position of the slider."""
    return Way(slider, first_us, last_us, SimpleNamespace(scale=scale), begin_m, slope)


def windows(slider, count, travel_m=0.006, until_us=10**12):
    """Return the windows at places evenly spaced along the readings."""
    way = way_of(slider)
    first_m, last_m = way.span_m
    places_m = first_m + (np.arange(count) + 0.5) / count * (last_m - first_m)
    return way_of(slider, 0, until_us).windows(places_m, travel_m)


def test_no_window_is_in_a_pause():
    """Promise: the middle of the way there and back is a pause; every place is passed twice."""
    slider = Slider(np.array([0, 1e6, 2e6 + 0.4, 3e6 + 0.4]), np.array([0, 0.2, 0.2, 0.0]))
    for count in (1, 2, 5, 10, 11):
        found = windows(slider, count)
        assert [(w.place, w.visit) for w in found] == [
            *((k, 0) for k in range(count)),
            *((k, 1) for k in reversed(range(count))),
        ]
        assert all(abs(slider.speed_mps(0.5 * (w.start_us + w.end_us))) > 0.1 for w in found)


def test_windows_there_and_back_are_at_the_same_places():
    """Promise: 5 places, 40 mm apart, each passed twice at two speeds, and windows around their
    middles to a tenth of a micrometer; those where the carriage speeds up are left out."""
    slider = strokes(SETTINGS)
    found = windows(slider, 5)
    assert len(found) == 20
    for window in found:
        start_m, end_m = window.x_m
        assert 0.5 * (start_m + end_m) == pytest.approx(0.02 + 0.04 * window.place, abs=1e-7)
        assert (end_m - start_m) * (-1) ** window.visit == pytest.approx(0.006, abs=1e-6)
    assert {window.visit for window in found if window.encoder_mps < 0.3} == {0, 1}
    assert {window.visit for window in found if window.encoder_mps > 0.3} == {2, 3}
    edge = [w for w in windows(slider, 20) if w.place in (0, 19)]  # 8 mm of 0.4 m/s are ramp
    assert {window.visit for window in edge} == {0, 1}


def test_a_visit_keeps_its_number_though_others_have_no_events():
    """Promise: the second stroke there is visit 2 also if the events begin after the first."""
    slider = strokes(SETTINGS)
    late = way_of(slider, 1_500_000).windows(np.array([0.1]), 0.006)
    assert [window.visit for window in late] == [1, 2, 3]


def test_there_and_back_are_directions_on_the_print():
    """Promise: also where the slider counts the other way."""
    slider = strokes(SETTINGS)
    reversed_ = Slider(slider.t_us, 0.2 - slider.x_m)
    one = way_of(slider).windows(np.array([0.05]), 0.006)
    way = way_of(reversed_, begin_m=0.2, slope=-1.0)
    other = way.windows(np.array([0.05]), 0.006)
    assert way.span_m == pytest.approx((0.0, 0.2))
    assert [(w.visit, w.start_us) for w in one] == [(w.visit, w.start_us) for w in other]


def test_the_travel_is_that_of_the_carriage():
    """Promise: where the encoder counts 2 mm as 1 mm, a window of 6 mm is 3 mm of readings."""
    slider = strokes(SETTINGS)
    found = way_of(slider, scale=2.0).windows(np.array([0.1]), 0.006)
    assert len(found) == 4
    for window in found:
        assert abs(window.x_m[1] - window.x_m[0]) == pytest.approx(0.003, abs=1e-6)


@pytest.mark.parametrize("step_m", [5e-6, 13e-6])
@pytest.mark.parametrize("jitter", [0, 1])
def test_windows_have_the_travel_though_the_encoder_has_steps(step_m, jitter):
    """Promise: the travel of a window is that which was asked for, to two steps of the encoder, and
    one that jitters by a step passes each place once."""
    t_us = np.arange(0.0, 1e6, 20.0 if jitter else 500.0)
    steps = np.round(0.21e-6 * t_us / step_m)
    slider = Slider(t_us, (steps + jitter * (np.arange(len(t_us)) % 2)) * step_m)
    found = windows(slider, 20)
    assert len(found) > 10
    assert len({window.place for window in found}) == len(found)
    assert {window.visit for window in found} <= {0}
    for window in found:
        assert abs(window.x_m[1] - window.x_m[0]) == pytest.approx(0.006, abs=2 * step_m)


@pytest.mark.parametrize("step_m", [8e-6, 12e-6, 20e-6])
@pytest.mark.parametrize("speed", [0.2, 0.407, 0.6])
def test_steps_of_the_encoder_cost_no_window(step_m, speed):
    """Promise: constant speed is that to a step of the encoder, so that recordings of three
    distances keep the same windows."""
    t_us = np.arange(0.0, 0.2e6 / speed, 500.0)
    for off_m in (0.0, 3e-6, 5e-6):
        slider = Slider(t_us, np.round((1e-6 * speed * t_us + off_m) / step_m) * step_m)
        assert len(windows(slider, 10)) == 10


def test_places_are_where_there_are_events():
    """Promise: a carriage that is parked far away after the recording moves no place there."""
    slider = strokes(SETTINGS)
    parked = Slider(
        np.append(slider.t_us, slider.t_us[-1] + 1e6 * np.arange(1, 4)),
        np.append(slider.x_m, [0.1, 0.3, 0.5]),
    )
    assert way_of(parked, 0, int(slider.t_us[-1])).span_m == pytest.approx((0.0, 0.2))
    assert way_of(parked).span_m == pytest.approx((0.0, 0.5))
    with pytest.raises(RigError, match="slider: the readings and the events do not overlap"):
        way_of(parked, -200, -100)


def test_a_window_has_one_speed_from_its_start_to_its_end():
    """Promise: a stroke shorter than a window, whose motion is symmetric about its middle, has
    none."""
    t_us = np.arange(0.0, 2e5, 1000.0)
    speed = np.interp(t_us, [5e4, 6e4, 8e4, 9e4], [0.0, 0.2, 0.2, 0.0])
    slider = Slider(t_us, np.concatenate([[0.0], np.cumsum(speed[1:] * 1e-3)]))
    assert 0.0055 < slider.x_m[-1] < 0.0065
    assert windows(slider, 1, 0.0055) == []
    assert windows(slider, 1, 0.005) == []
    assert len(windows(slider, 1, 0.0035)) == 1


def test_windows_that_pass_the_ends_of_the_events_are_left_out():
    """Promise: they are not a reason to score none of the others."""
    t_us = np.arange(0.0, 3e5, 500.0)
    slider = Slider(t_us, 0.2e-6 * t_us)
    assert len(windows(slider, 5, 0.01)) == 5
    assert [w.place for w in windows(slider, 5, 0.01, until_us=200_000)] == [0, 1, 2]


def test_a_file_of_a_spreadsheet_begins_with_a_byte_order_mark(tmp_path):
    (tmp_path / "slider.csv").write_text("t_us,x_m\n0,0\n5,1\n", encoding="utf-8-sig")
    assert read_slider(tmp_path / "slider.csv").x_m.tolist() == [0.0, 1.0]


@pytest.mark.parametrize("interval_us", [None, 0.3])
def test_files_keep_every_digit(tmp_path, interval_us):
    """Promise: what is written is read again, also with several readings in a microsecond."""
    slider = strokes(SETTINGS)
    if interval_us:
        slider = Slider(interval_us * np.arange(len(slider.x_m)), slider.x_m)
    (tmp_path / "slider.csv").write_text(slider_text(slider))
    back = read_slider(tmp_path / "slider.csv")
    assert np.array_equal(back.t_us, slider.t_us)
    assert np.array_equal(back.x_m, slider.x_m)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t_us,x_m\n0,0\n", "found 1 readings"),
        ("t_us\n0\n1\n", "no column x_m"),
        ("t_us,x_m\n0,0\n5,\n", "line 3: x_m: has no value"),
        ("t_us,x_m\n0,0\n5,a\n", "could not convert"),
        ("t_us,x_m\n0,0\n5,nan\n", "finite numbers"),
        ("t_us,x_m\n5,0\n0,1\n", "reading 2: found 1 m at 0 us"),
        (
            "t_us,x_m\n" + "".join(f"{t},{t * 1e-6}\n" for t in [*range(50), *range(500, 550)]),
            "no readings from 49 to 500 us",
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
    with pytest.raises(RigError, match="both clocks agree"):
        slider.position_m([101.0])


def test_frames_are_those_of_slow_motion():
    """Promise: with a limit, no frame of a faster stroke is used, however near to a slow time."""
    slider = strokes(SETTINGS)
    taken_us = slider.evenly_along(40, 0.0, slider.t_us[-1])  # as `eres rig render` takes them
    frames = tuple(SimpleNamespace(t_us=int(t_us)) for t_us in taken_us)
    has = {"slider": slider, "frames": frames, "codes": lambda frame: None}
    recording = SimpleNamespace(folder=Path("near"), **has)
    for limit, fastest in ((0.25, 0.2), (np.inf, 0.4)):
        used_us = [t_us for t_us, _ in _frames(recording, 40, limit)]
        assert np.abs(slider.speed_mps(np.array(used_us))).max() == pytest.approx(fastest, rel=1e-3)
    with pytest.raises(RigError, match=r"no frame .* 0\.01"):
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
    with pytest.raises(RigError, match=r"no readings from 29.* to 40.* us"):
        Slider(t_us[kept], x_m[kept]).check_gaps()
