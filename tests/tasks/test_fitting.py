"""`eres fit` gets back the parameters of simulated sensors, inside its own intervals."""

import functools
import math
import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from moving_texture import texture_in_motion
from sensor import (
    EventCamera,
    EventFormatError,
    Events,
    SensorModel,
    find_camera,
    plain_camera,
    read_camera,
    simulate,
    write_camera,
)
from sensor.events import concatenate
from sensor.formats import Triggers, read_events, write_events
from tasks.errors import TaskError
from tasks.fitting.check import compare, parts_of
from tasks.fitting.fit import Evidence, Found
from tasks.fitting.fit import fit as fit_recording
from tasks.fitting.response import fit_response, read_steps
from tasks.fitting.stillness import Noise, counts, fit_noise, neighbors_together
from tasks.footage import Footage
from tasks.numerics.estimate import Estimate, bootstrap, poisson_rate, share
from tasks.recording.frames import open_frames
from tasks.recording.levels import Levels, best_delay_us, busiest, fit_line, levels_of, solved
from tasks.recording.motion import fit_motion, lag
from tasks.recording.threshold import fit_thresholds

HEIGHT, WIDTH = 60, 80


def inside(estimate, truth):
    assert estimate.low <= truth <= estimate.high, f"{estimate} misses {truth}"


@functools.cache
def still(seconds=4.0, settled_s=8.0, **electronics):
    """Return the events of the last seconds in constant light, and their number of seconds."""
    model = SensorModel(width=WIDTH, height=HEIGHT, dark_level=1.0, **electronics)
    light = np.full((41, HEIGHT, WIDTH), 3.0)
    events = simulate(light, np.linspace(0, settled_s + seconds, 41), model, seed=4)
    return events.between(round(1e6 * settled_s), round(1e6 * (settled_s + seconds))), seconds


@pytest.mark.parametrize(("leak_hz", "shot_hz"), [(0.0, 0.0), (0.5, 0.0), (0.0, 2.0), (0.3, 1.0)])
def test_stillness_gives_back_leak_and_shot_noise(leak_hz, shot_hz):
    """Promise: the rates of a simulated sensor lie in the intervals."""
    events, seconds = still(
        leak_hz=leak_hz,
        shot_noise_hz=shot_hz,
        shot_noise_exponent=0.0,
        random_start=True,
        threshold_mismatch=0.01,
    )
    noise = fit_noise(*counts(events), seconds)
    inside(noise.leak_hz, leak_hz)
    inside(noise.shot_noise_hz, shot_hz)
    assert noise.hot.sum() == 0
    assert noise.hot_pixel_hz is None


def test_stillness_gives_back_hot_pixels():
    events, seconds = still(shot_noise_hz=1.0, hot_pixel_fraction=0.01, hot_pixel_hz=50.0)
    noise = fit_noise(*counts(events), seconds)
    inside(noise.hot_pixels, 0.01)
    inside(noise.hot_pixel_hz, 50.0)
    inside(noise.shot_noise_hz, 1.0 * 4**-0.5)


@pytest.mark.parametrize("size", [(1, 50), (50, 1)])
def test_a_single_row_of_pixels_is_tested_for_stillness_too(size):
    """Promise: neighbors in the one direction that has some count."""
    y, x = np.mgrid[: size[0], : size[1]].reshape(2, -1).astype(np.uint16)
    t_us = np.repeat(np.array([10, 4_000, 90_000]), x.size)
    p = np.ones(t_us.size, np.int8)
    events = Events(t_us, np.tile(x, 3), np.tile(y, 3), p, width=size[1], height=size[0])
    assert neighbors_together(events, np.zeros(size, np.bool_)) == pytest.approx(1.0)


def test_a_stretch_that_is_not_still_is_said(caplog):
    """Promise: neighbors fire independently of each other in noise, and together in motion."""
    events, seconds = still(shot_noise_hz=4.0, hot_pixel_fraction=0.01, hot_pixel_hz=50.0)
    fit_recording(events, Evidence(still_s=(0.0, seconds - 0.01)))
    assert caplog.text == ""
    moving, t_s = texture_in_motion(3, 41, (HEIGHT, WIDTH), 1e-3, travel_px=4.0)
    events = simulate(moving, t_s, SensorModel(width=WIDTH, height=HEIGHT))
    fit_recording(events, Evidence(still_s=(0.0, 0.03)))
    assert "still: events of neighboring pixels are correlated" in caplog.text


def test_a_fitted_camera_has_the_noise_of_the_recording():
    """Promise: the camera fires as much noise in the same light."""
    events, seconds = still(shot_noise_hz=4.0)  # 2 Hz in this light
    found = fit_recording(events, Evidence(still_s=(0.0, seconds - 0.01)))
    camera = replace(found.camera(plain_camera(WIDTH, HEIGHT), "rec.h5"), dark_share=1.0)
    again = camera.simulate(np.full((2, HEIGHT, WIDTH), 3.0), [0.0, seconds], white=1.0, seed=9)
    assert len(again) == pytest.approx(len(events), rel=0.02)


def test_intervals_of_counts_are_the_textbooks():
    """Source: Garwood 1936, 0 events: 0 to 3.69; 10: 4.80 to 18.39. Clopper and Pearson 1934, 0 of
    10: 0 to 0.308."""
    assert poisson_rate(0, 1.0) == pytest.approx((0, 0, 3.689), abs=1e-3)
    assert poisson_rate(10, 1.0) == pytest.approx((10, 4.795, 18.39), abs=1e-2)
    assert share(0, 10) == pytest.approx((0, 0, 0.3085), abs=1e-4)


@functools.cache
def texture():
    light, t_s = texture_in_motion(3, 120, (HEIGHT, WIDTH), 2e-3, travel_px=42.0)
    return light / light.max(), t_s


def light_every(step):
    """Return every n-th frame of the texture, whose motion from one to the next is 0.35 n px."""
    light, t_s = texture()
    return Footage(
        path=Path("texture"),
        t_s=t_s[::step],
        t_offset_us=0,
        height=HEIGHT,
        width=WIDTH,
        encoding="linear",
        white_level=1.0,
        frames=lambda: iter(light[::step]),
    )


@functools.cache
def moving(C_on, C_off, dark, **electronics):
    """Return the events of a sensor that sees the texture."""
    light, t_s = texture()
    model = SensorModel(
        width=WIDTH,
        height=HEIGHT,
        contrast_threshold=C_on,
        contrast_threshold_off=C_off,
        dark_level=dark,
        random_start=True,
        **electronics,
    )
    return simulate(light, t_s, model, seed=1)


@pytest.fixture(autouse=True)
def few_events(monkeypatch):
    """Keep these tests fast."""
    monkeypatch.setattr("tasks.recording.levels._MAX_EVENTS", 8_000)


def known(events, dark):
    """Return the levels at the events with the light of all frames, and of every second."""
    return [levels_of(events, light_every(step), dark) for step in (1, 2)]


@pytest.mark.parametrize("poles", [1, 2])
def test_light_behind_the_photoreceptor_is_that_of_its_equation(poles):
    """Promise: light that is piecewise linear in log units, filtered and delayed, solves the poles'
    differential equations at any time."""
    rng = np.random.default_rng(5)
    t_s, u = np.cumsum(rng.uniform(1e-3, 5e-3, 8)), rng.normal(0, 1, 8)
    at_s = np.sort(rng.uniform(t_s[0], t_s[-1], 30))
    zeros = np.zeros(30, np.int64)
    late_us = 700.0
    levels = Levels(
        *(1e6 * t_s, u[:, None], 0.0, 1e6 * at_s + late_us, zeros, zeros, zeros, zeros, zeros)
    )
    pole_s = 2e-3

    def slope(t, v):
        return (np.append(np.interp(t, t_s, u), v[:-1]) - v) / pole_s

    span = {"max_step": 1e-4, "rtol": 1e-9, "atol": 1e-9}
    exact = solve_ivp(slope, (t_s[0], t_s[-1]), [u[0]] * poles, t_eval=at_s, **span).y[-1]
    found = levels.light_at_events(late_us, pole_s, poles)
    np.testing.assert_allclose(found, exact, atol=1e-6)
    straight = levels.light_at_events(late_us)
    np.testing.assert_allclose(straight, np.interp(at_s, t_s, u), atol=1e-12)


def test_thresholds_of_exact_levels_are_exact():
    """Promise: events at the times at which a zigzag of log light is at its levels give C_on and
    C_off to the last digits, whatever the unknown level of each pixel is."""
    C_on, C_off = 0.3, 0.2
    ons = np.array([[1, 2, 3, 3, 3, 4, 5], [0, 0, 1, 2, 2, 3, 3]])
    offs = np.array([[0, 0, 0, 1, 2, 2, 2], [1, 2, 2, 2, 3, 3, 4]])
    log_light = (C_on * ons - C_off * offs).T + np.array([0.0, 1.0])
    t_us, pixel = 1e3 * np.arange(7), np.repeat([0, 1], 7)
    counts = 9.0 + ons.ravel(), 9.0 + offs.ravel()
    levels = Levels(t_us, log_light, 0.0, np.tile(t_us, 2), pixel, *counts, pixel, pixel)
    found = fit_line(levels)
    assert (found.on, found.off) == (pytest.approx(C_on), pytest.approx(C_off))
    assert found.unexplained == pytest.approx(0, abs=1e-9)


def test_intervals_of_a_small_part_are_those_of_its_pixels():
    """Promise: motion in one corner gives an interval of about the width that its number of events
    gives, not one of no width because it is in a single tile."""
    events = moving(0.2, 0.25, 1e-2, threshold_mismatch=0.03)
    corner = events.where((events.x < 8) & (events.y < 8))
    (levels, _), (all_levels, _) = known(corner, 1e-2), known(events, 1e-2)
    width, all_width = (bootstrap(fit_line(one).sums, solved)[0] for one in (levels, all_levels))
    times = math.sqrt(len(all_levels.t_us) / len(levels.t_us))
    assert width.high - width.low > 0.3 * times * (all_width.high - all_width.low)


def test_events_of_one_polarity_are_refused_in_words():
    events = moving(0.2, 0.25, 1e-2)
    with pytest.raises(TaskError, match="thresholds: the change of the light does not match"):
        fit_thresholds(*known(events.where(events.p > 0), 1e-2))


@pytest.mark.parametrize(
    ("C_on", "C_off", "dark"), [(0.2, 0.2, 1e-3), (0.15, 0.25, 1e-2), (0.35, 0.28, 1e-1)]
)
def test_frames_give_back_the_thresholds(C_on, C_off, dark):
    """Promise: both thresholds lie in their intervals, at the dark level of the sensor."""
    events = moving(C_on, C_off, dark, threshold_mismatch=0.01)
    levels, coarse = known(events, dark)
    found = fit_thresholds(levels, coarse, best_delay_us(levels))
    inside(found.on, C_on)
    inside(found.off, C_off)
    assert found.on.high - found.on.low < 0.2 * C_on
    assert found.unexplained < 0.05


@pytest.mark.parametrize(
    ("cutoff_hz", "photoreceptor", "raised"),
    [
        pytest.param(200.0, "two_pole", 1.01, marks=pytest.mark.slow),
        (50.0, "two_pole", 1.05),
        pytest.param(50.0, "one_pole", 1.03, marks=pytest.mark.slow),
    ],
)
def test_a_slow_photoreceptor_does_not_raise_the_thresholds(cutoff_hz, photoreceptor, raised):
    """Physics: it smooths the light before the comparator; light that is only late changes more."""
    events = moving(0.2, 0.25, 1e-2, cutoff_hz=cutoff_hz, photoreceptor=photoreceptor)
    levels, coarse = known(events, 1e-2)
    found = fit_thresholds(levels, coarse, *lag(levels))
    late = fit_thresholds(levels, coarse, best_delay_us(levels))
    for one, delayed, C in zip(found[:2], late[:2], (0.2, 0.25), strict=True):
        assert one.low < C < one.high
        assert one.value == pytest.approx(C, rel=0.02)
        assert delayed.value > raised * one.value


def test_a_wrong_dark_level_gives_other_thresholds():
    """Promise: the sweep shows the effect of the dark level: a higher one gives smaller changes."""
    (levels, _) = known(moving(0.2, 0.2, 1e-2), 1e-2)
    values = [fit_line(levels.at_dark(dark)).on for dark in (1e-2, 1e-1, 3e-1)]
    assert values[0] == pytest.approx(0.2, rel=0.02)
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.75 * values[0]


def test_noise_and_hot_pixels_change_little():
    """Promise: outliers bias the thresholds by a few percent at most."""
    noisy = {"hot_pixel_fraction": 0.01, "hot_pixel_hz": 300.0, "shot_noise_hz": 1.0}
    (levels, _) = known(moving(0.2, 0.2, 1e-2, **noisy), 1e-2)
    found = fit_line(levels)
    assert found.on == pytest.approx(0.2, rel=0.05)
    assert found.off == pytest.approx(0.2, rel=0.05)


@pytest.mark.parametrize(
    ("cutoff_hz", "latency_s", "photoreceptor"),
    [
        (200.0, 5e-4, "two_pole"),
        pytest.param(50.0, 1e-3, "two_pole", marks=pytest.mark.slow),
        pytest.param(100.0, 5e-4, "one_pole", marks=pytest.mark.slow),
    ],
)
def test_motion_gives_back_cutoff_and_latency(cutoff_hz, latency_s, photoreceptor):
    """Promise: events of light in known motion separate the filter from a delay, with informative
    intervals, and thresholds after the filter are those of the sensor."""
    slow = {"cutoff_hz": cutoff_hz, "latency_s": latency_s, "photoreceptor": photoreceptor}
    levels, coarse = known(moving(0.2, 0.25, 1e-2, threshold_mismatch=0.01, **slow), 1e-2)
    found = fit_motion(levels, coarse)
    poles = 2 if photoreceptor == "two_pole" else 1
    assert found.photoreceptor in (photoreceptor, None)
    inside(found.delay_s, latency_s + poles / (2 * np.pi * cutoff_hz))
    inside(found.cutoff_hz, cutoff_hz)
    inside(found.latency_s, latency_s)
    assert found.cutoff_hz.high < 3 * found.cutoff_hz.low
    late = 1e6 * found.latency_s.value, found.pole_s, found.poles
    thresholds = fit_thresholds(levels, coarse, *late)
    inside(thresholds.on, 0.2)
    inside(thresholds.off, 0.25)


def test_a_sensor_without_a_delay_has_no_cutoff_and_no_latency():
    """Promise: neither the end of the search nor a microsecond of doubt is an error, and what is
    found there is in its interval."""
    levels, coarse = known(moving(0.2, 0.2, 1e-2), 1e-2)
    found = fit_motion(levels, coarse)
    for one in (found.delay_s, found.cutoff_hz, found.latency_s):
        assert one.low <= one.value <= one.high
    assert found.delay_s.value < 1e-4
    assert found.cutoff_hz.value > 1e3
    assert np.isinf(found.cutoff_hz.high)


@pytest.mark.slow
@pytest.mark.parametrize("photoreceptor", ["two_pole", "one_pole"])
def test_the_search_does_not_end_where_it_starts(photoreceptor):
    """Promise: clean light of one frequency gives back cutoff and poles, not the first guess of the
    filter's share; there a slow pole hides from a crude end of the search, and one pole behind a
    better fit that is not the best."""
    t_s = np.arange(0, 0.5, 0.002)
    base = 0.05 * (1 + np.random.default_rng(0).random((32, 32)))
    light = (np.exp(1 + np.sin(9 * t + 6 * base / 0.05)) for t in t_s)
    frames = [(base * one).astype(np.float32) for one in light]
    model = SensorModel(
        width=32,
        height=32,
        contrast_threshold=0.1,
        cutoff_hz=50.0,
        dark_level=1e-3,
        photoreceptor=photoreceptor,
    )
    footage = Footage(Path("light"), t_s, 0, 32, 32, "linear", 1.0, lambda: iter(frames))
    events = simulate(frames, t_s, model)
    motion = fit_recording(events, Evidence(light=footage, motion=True)).motion
    inside(motion.cutoff_hz, 50.0)
    assert motion.photoreceptor == photoreceptor


@pytest.mark.slow
def test_motion_that_is_too_slow_says_so():
    """Promise: where the filter is far faster than the light changes, the delay is known, and the
    cutoff has no upper end."""
    levels, coarse = known(moving(0.2, 0.2, 1e-2, cutoff_hz=3000.0, latency_s=2e-3), 1e-2)
    found = fit_motion(levels, coarse)
    inside(found.delay_s, 2e-3 + 2 / (2 * np.pi * 3000.0))
    inside(found.cutoff_hz, 3000.0)
    assert np.isinf(found.cutoff_hz.high)


def test_events_before_their_light_are_refused():
    """Promise: clocks that disagree are an error, not a latency."""
    events = moving(0.2, 0.2, 1e-2)
    late = Events(events.t_us - 3000, events.x, events.y, events.p, WIDTH, HEIGHT)
    late = late.between(0, int(events.t_us[-1]))
    with pytest.raises(TaskError, match=r"motion: events precede the light .* by 3\d{3} us"):
        fit_motion(*known(late, 1e-2))


@pytest.mark.slow
def test_a_delay_beyond_the_search_is_refused():
    """Promise: two poles at 20 Hz are late by 16 ms, and 0.27 s of light shows up to 14 ms: neither
    a cutoff nor thresholds of a shorter delay are given, where intervals would miss the truth."""
    levels, coarse = known(moving(0.1, 0.1, 1e-2, cutoff_hz=20.0), 1e-2)
    found = "events follow the light by 13.6 ms or more, a twentieth of the 272.4 ms"
    with pytest.raises(TaskError, match=f"^motion: {found} .*; give a longer stretch"):
        fit_motion(levels, coarse)
    with pytest.raises(TaskError, match=f"^thresholds: {found}"):
        lag(levels)


def test_motion_of_events_that_do_not_fit_is_refused():
    """Promise: inverted polarity is an error in one line."""
    events = moving(0.2, 0.2, 1e-2)
    wrong = Events(events.t_us, events.x, events.y, -events.p, WIDTH, HEIGHT)
    with pytest.raises(TaskError, match="change of the light does not match the events"):
        fit_motion(*known(wrong, 1e-2))


@functools.cache
def flashes(cutoff_hz, latency_s, photoreceptor="two_pole", steps=8):
    """Return the events of a flashing light, and the times of its rises in us."""
    half_s = 1.6 / cutoff_hz
    rises_s = half_s * (1 + 2 * np.arange(steps))
    edges = np.sort(np.concatenate([rises_s, rises_s + half_s]))
    t_s = np.concatenate([[0.0], np.stack([edges, edges + 1e-6], axis=1).ravel()])
    bright = np.concatenate([[0], np.tile([0, 1, 1, 0], steps)])
    base = np.exp(np.random.default_rng(0).normal(-2, 0.3, (24, 24)))
    model = SensorModel(
        width=24,
        height=24,
        cutoff_hz=cutoff_hz,
        photoreceptor=photoreceptor,
        dark_level=1e-6,
        random_start=True,
        threshold_mismatch=0.03,
        latency_s=latency_s,
    )
    events = simulate(base * np.exp(2.5 * bright)[:, None, None], t_s, model, seed=2)
    return events, np.round(1e6 * rises_s).astype(np.int64)


@pytest.mark.parametrize("photoreceptor", ["two_pole", "one_pole"])
@pytest.mark.parametrize(("cutoff_hz", "latency_s"), [(50.0, 1e-3), (200.0, 2e-4), (900.0, 5e-5)])
def test_flashes_give_back_cutoff_and_latency(cutoff_hz, latency_s, photoreceptor):
    """Promise: the kind of photoreceptor is found, its cutoff and latency are in the intervals."""
    found = fit_response(*flashes(cutoff_hz, latency_s, photoreceptor))
    assert found.photoreceptor == photoreceptor
    inside(found.cutoff_hz, cutoff_hz)
    inside(found.latency_s, latency_s)
    assert found.cutoff_hz.high < 1.4 * found.cutoff_hz.low
    early, middle, late = found.first_event_s
    assert latency_s < early <= middle <= late


def test_steps_that_the_recording_does_not_have_do_not_count():
    """Promise: a recording that begins or ends in the answer to a step, or a list with times that
    it does not have, gives the estimates of the whole steps alone."""
    events, rises_us = flashes(100.0, 5e-4, steps=5)
    whole = fit_response(events, rises_us)
    assert whole.steps == 5
    period_us = int(rises_us[1] - rises_us[0])
    beyond = np.concatenate([[rises_us[0] - period_us], rises_us, [rises_us[-1] + period_us]])
    assert fit_response(events, beyond) == whole
    late_us = 2500  # in the middle of an answer
    cut = events.between(rises_us[0] + late_us, rises_us[-1] + late_us)
    found = fit_response(cut, rises_us)
    assert found == fit_response(cut, rises_us[1:-1])
    assert found.steps == 3
    inside(found.cutoff_hz, 100.0)
    inside(found.latency_s, 5e-4)
    with pytest.raises(TaskError, match=r"steps: .* 1 of 5 steps"):
        fit_response(events.between(0, rises_us[1] + late_us), rises_us)


def with_background(events, pixels, count):
    """Return the events on a larger sensor, with ON events of other pixels at random times."""
    rng = np.random.default_rng(1)
    x, y = (np.tile(one, count) for one in rng.integers(24, 96, (2, pixels)))
    columns = rng.integers(0, events.t_us[-1], x.size), x, y, np.ones(x.size)
    both = [np.concatenate(pair) for pair in zip(events.columns, columns, strict=True)]
    order = np.argsort(both[0], kind="stable")
    kinds = "i8", "u2", "u2", "i1"
    return Events(*(one[order].astype(k) for one, k in zip(both, kinds, strict=True)), 96, 96)


@pytest.mark.parametrize("side", [4, 8])
@pytest.mark.parametrize(("pixels", "count"), [(20, 24), (40, 100), (1, 5000)])
def test_a_small_lamp_is_told_from_background(side, pixels, count):
    """Promise: pixels that fire at random, more than see the lamp, or a hot one with more events
    than all of these, change neither cutoff nor latency; a lamp in a single tile has intervals
    too."""
    events, rises_us = flashes(200.0, 2e-4)
    lamp = events.where((events.x < side) & (events.y < side))
    found = fit_response(with_background(lamp, pixels, count), rises_us)
    inside(found.cutoff_hz, 200.0)
    inside(found.latency_s, 2e-4)


def test_draws_of_dim_pixels_alone_are_left_out():
    """Promise: where most pixels see just enough of the lamp for an event, no draw of these ends in
    a traceback; if nearly all do, it is an error."""
    events, rises_us = flashes(200.0, 2e-4)
    lamp = events.where((events.x < 4) & (events.y < 4))
    step = np.searchsorted(rises_us, lamp.t_us, side="right")
    place = (step * 16 + lamp.y * 4 + lamp.x) * 2 + (lamp.p > 0)
    is_first = np.zeros(len(lamp), bool)
    is_first[np.unique(place, return_index=True)[1]] = True
    found = fit_response(lamp.where(is_first | (lamp.y == 0)), rises_us)
    assert found.cutoff_hz.low < found.cutoff_hz.value < found.cutoff_hz.high
    with pytest.raises(TaskError, match="steps: found"):
        fit_response(lamp.where(is_first | (lamp.y + lamp.x == 0)), rises_us)


def test_steps_too_close_for_pixels_to_settle_are_refused():
    """Promise: the error says that pixels were left out for firing on, not that events lack."""
    events, rises_us = flashes(200.0, 2e-4)
    half_later_us = rises_us - int(np.diff(rises_us).min()) * 2 // 3
    with pytest.raises(TaskError, match="steps: no pixel fires after a step and falls"):
        fit_response(events, half_later_us)


def test_events_at_too_few_times_are_refused():
    """Promise: a clock too coarse for a curve is an error in one line."""
    events, rises_us = flashes(200.0, 2e-4)
    late = np.searchsorted(rises_us, events.t_us, side="right") - 1
    coarse = Events(rises_us[np.maximum(late, 0)] + 5, *events.columns[1:], 24, 24)
    with pytest.raises(
        TaskError, match=r"steps: found . distinct event times .*expected at least 5"
    ):
        fit_response(coarse, rises_us)


def frames_of(folder, step):
    """Write every n-th frame of the texture, as floats, with their times."""
    light, t_s = texture()
    folder.mkdir()
    rows = ["t_us_start,t_us_end,file"]
    for k in range(0, len(light), step):
        cv2.imwrite(f"{folder}/{k:04d}.tiff", light[k])
        t_us = round(1e6 * t_s[k])
        rows.append(f"{t_us},{t_us},{k:04d}.tiff")
    (folder / "frames.csv").write_text("\n".join(rows))
    return folder


def test_dark_levels_that_nobody_asked_for_may_not_fit(tmp_path, monkeypatch):
    """Promise: the sweep has the levels that fit."""
    real, asked = fit_thresholds, []

    def refusing_some(levels, *given):
        asked.append(levels)
        if len(asked) in (2, 3):
            raise TaskError("changes of the light that do not fit")
        return real(levels, *given)

    monkeypatch.setattr("tasks.fitting.darkness.fit_thresholds", refusing_some)
    frames = open_frames(frames_of(tmp_path / "frames", 6), encoding="linear")
    found = fit_recording(recorded(dark_share=1e-2), Evidence(frames=frames))
    inside(found.thresholds.on, 0.2)
    assert len(found.sweep) == len(asked) - 2 > 2


@functools.cache
def recorded(still_s=0.0, **changes):
    """Return what a camera records of the texture, and then of a still image."""
    light, t_s = texture()
    white = float(np.percentile(light[0], 99.9))
    if still_s:
        light, t_s = np.concatenate([light, light[-1:]]), np.append(t_s, t_s[-1] + still_s)
    usual = {"contrast_threshold": 0.2, "contrast_threshold_off": 0.25, "random_start": True}
    camera = replace(plain_camera(WIDTH, HEIGHT), **usual | changes)
    return camera.simulate(light, t_s, white=white, seed=1)


@pytest.mark.parametrize("dark", [5e-3, pytest.param(1e-1, marks=pytest.mark.slow)])
def test_all_parameters_come_back_in_their_intervals(eres, tmp_path, dark):
    """Promise: thresholds, cutoff, latency, dark level and noise of a simulated camera, none of
    which is given, lie in the intervals of the file."""
    truth = {
        "contrast_threshold": 0.3,
        "contrast_threshold_off": 0.24,
        "dark_share": dark,
        "cutoff_hz": 100.0,
        "latency_s": 1e-3,
        "leak_hz": 0.5,
        "shot_noise_hz": 1.0,
        "shot_noise_exponent": 0.0,
    }
    events = recorded(12.0, threshold_mismatch=0.01, **truth)
    write_events(tmp_path / "recording.h5", events)
    folder, out = frames_of(tmp_path / "frames", 2), tmp_path / "mine.toml"
    code, _, err = eres(
        *("fit", tmp_path / "recording.h5", "--out", out, "--frames", folder, "--motion"),
        *("--still", "8.2", "12.2", "--check", "none"),
    )
    assert (code, err) == (0, "")
    camera = read_camera(out)
    for key, field in (
        *(("threshold", "contrast_threshold"), ("threshold_off", "contrast_threshold_off")),
        *(("dark", "dark_share"), ("cutoff", "cutoff_hz"), ("latency", "latency_s")),
        *(("leak", "leak_hz"), ("shot_noise", "shot_noise_hz")),
    ):
        source = camera.sources[key]
        assert source.kind == "measured", key
        assert source.interval[0] < truth[field] < source.interval[1], (key, source)
        assert source.interval[0] < getattr(camera, field) < source.interval[1]
    assert camera.photoreceptor == "two_pole"


@pytest.mark.slow
@pytest.mark.parametrize("option", [(), ("--dark", 1e-2)])
def test_a_fitted_camera_gives_the_counts_back(eres, tmp_path, option):
    """Promise: fit, then simulate with the file alone: the numbers of events at a dark level of 1 %
    of white are those of the recording, with the level given or found."""
    events = recorded(dark_share=1e-2)
    write_events(tmp_path / "recording.h5", events)
    folder, out = frames_of(tmp_path / "frames", 1), tmp_path / "mine.toml"
    arguments = "fit", tmp_path / "recording.h5", "--out", out, "--frames", folder, *option
    code, printed, err = eres(*arguments)
    assert (code, err) == (0, "")
    for row in ("ON events", "OFF events", "events"):
        ratio = re.search(rf"^ *{row} +\d+ +\d+ +([.\d]+)$", printed, re.MULTILINE)[1]
        assert float(ratio) == pytest.approx(1, abs=0.04), row
    simulated = tmp_path / "again.npz"
    code, printed, err = eres("simulate", folder, "--fps", 500, "--sensor", out, "--out", simulated)
    assert (code, err) == (0, "")
    again = concatenate(list(read_events(simulated)))
    for p in (-1, 1):
        assert np.sum(again.p == p) == pytest.approx(np.sum(events.p == p), rel=0.04)


@pytest.mark.parametrize(
    ("check", "dark_share"),
    [("first", 2e-2), pytest.param("second", None, marks=pytest.mark.slow)],
)
def test_the_held_out_half_chooses_nothing(tmp_path, check, dark_share):
    """Promise: the fit is that of a recording which ends, or begins, at the middle frame, with its
    dark level given or found."""
    events = recorded(dark_share=2e-2, cutoff_hz=100.0)
    frames = open_frames(frames_of(tmp_path / "frames", 6), encoding="linear")
    frames = busiest([events], frames)
    found = fit_recording(events, Evidence(frames=frames, check=check, dark_share=dark_share))
    middle = (len(frames) - 1) // 2
    numbers = np.arange(middle + 1) if check == "second" else np.arange(middle, len(frames))
    own = frames.some(numbers)
    start_us, end_us = own.middle_us[[0, -1]].tolist()
    near = events.between(start_us - 1000, end_us + 1000)
    alone = fit_recording(near, Evidence(frames=own, dark_share=dark_share))
    assert replace(found, agreement=None) == alone
    counted = found.agreement.counted_us
    assert (counted[0] >= end_us) if check == "second" else (counted[1] <= start_us)


def test_a_camera_is_compared_in_its_own_light(tmp_path):
    """Promise: the camera that recorded agrees with its recording in every row; one with twice the
    thresholds has less than half of the events, at longer intervals."""
    dark = {"dark_share": 1e-2}
    events = recorded(**dark)
    frames = open_frames(frames_of(tmp_path / "frames", 2), encoding="linear")
    _, held_out = parts_of(events, frames, "second")
    camera = replace(
        plain_camera(WIDTH, HEIGHT), contrast_threshold=0.2, contrast_threshold_off=0.25, **dark
    )
    found = compare(events, held_out, camera)
    counted = events.between(*found.counted_us)
    assert found.real == (np.sum(counted.p > 0), np.sum(counted.p < 0))
    np.testing.assert_allclose(found.simulated, found.real, rtol=0.02)
    np.testing.assert_allclose(found.quartiles, 1, atol=0.03)
    assert found.simulated_us == pytest.approx(found.real_us, rel=0.05)
    coarse = replace(camera, contrast_threshold=0.4, contrast_threshold_off=0.5)
    found = compare(events, held_out, coarse)
    assert np.all(np.array(found.simulated) < 0.5 * np.array(found.real))
    assert found.simulated_us > 1.5 * found.real_us


def test_a_dark_level_that_is_only_bounded_is_the_cameras(tmp_path):
    """Promise: where the dimmest light is 20 times the dark level, it is bounded; the thresholds
    hold at the level of the camera, which keeps it."""
    frames = open_frames(frames_of(tmp_path / "frames", 6), encoding="linear")
    known = replace(plain_camera(WIDTH, HEIGHT), dark_share=2e-3)
    found = fit_recording(recorded(dark_share=1e-3), Evidence(frames=frames, camera=known))
    assert found.dark.is_bound
    assert found.thresholds.dark == 2e-3
    camera = found.camera(known, "rec.h5")
    assert camera.dark_share == 2e-3
    inside(found.dark, 1e-3)
    inside(found.thresholds.on, 0.2)


@pytest.mark.slow
def test_the_command_completes_a_camera(eres, tmp_path):
    """Promise: the values of --sensor stay where the recording shows none; what was measured
    replaces them, and with the cutoff goes the light in which the old one held; frames may be
    several pixels of motion apart."""
    events = moving(0.2, 0.25, 1e-2, cutoff_hz=100.0, latency_s=1e-3)
    write_events(tmp_path / "recording.h5", events)
    folder = frames_of(tmp_path / "frames", 6)
    base = replace(find_camera("dvs128"), width=WIDTH, height=HEIGHT, refractory_s=1e-6)
    write_camera(tmp_path / "base.toml", base)
    out = tmp_path / "mine.toml"
    code, printed, err = eres(
        *("fit", tmp_path / "recording.h5", "--out", out, "--frames", folder, "--motion"),
        *("--dark", 1e-2, "--still", "0", "0.1", "--title", "My camera"),
        *("--sensor", tmp_path / "base.toml"),
    )
    assert (code, err) == (0, "")
    assert "delay of slow changes: 0.004" in printed
    camera = read_camera(out)
    assert (camera.title, camera.pitch_um, camera.refractory_s) == ("My camera", 40, 1e-6)
    assert camera.illuminance_lux is None
    assert camera.dark_share == 1e-2
    assert camera.sources["dark"].kind == "given"
    for name, truth in (("threshold", 0.2), ("threshold_off", 0.25), ("cutoff", 100.0)):
        low, high = camera.sources[name].interval
        assert low < truth < high, name
    at = "recording.h5: light in motion, with a dark level of 1 % of white"
    assert camera.sources["threshold"].text == at
    code, _, err = eres("fit", tmp_path / "recording.h5", "--out", out, "--still", "0", "0.1")
    assert (code, "already exists" in err) == (1, True)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--dark", 1e-2), "--dark needs --frames or --crop"),
        (("--check", "first"), "--check needs --frames or --crop"),
        (("--sensor", "davis346"), "sensor: davis346 has 346x260 px, but .*h5 has 80x60 px"),
    ],
)
def test_options_that_do_not_fit_the_recording_are_refused(eres, tmp_path, options, text):
    """Promise: one line, and no file."""
    write_events(tmp_path / "recording.h5", moving(0.2, 0.2, 1e-2)[:999])
    arguments = "fit", tmp_path / "recording.h5", "--out", tmp_path / "mine.toml"
    code, _, err = eres(*arguments, "--still", "0", "0.001", *options)
    assert (code, err.count("\n")) == (1, 1)
    assert re.search(text, err)
    assert not (tmp_path / "mine.toml").exists()


def test_four_frames_have_no_halves(tmp_path):
    """Promise: the error says how many there are, and which option fits all of them."""
    frames = open_frames(frames_of(tmp_path / "frames", 30), encoding="linear")
    with pytest.raises(TaskError, match=r"^--check: found 4 frames .* --check none skips"):
        fit_recording(moving(0.2, 0.2, 1e-2), Evidence(frames=frames, check="second"))


def test_too_few_events_do_not_choose_a_dark_level(tmp_path):
    events = recorded(dark_share=1e-2)
    few = events.where((events.x < 2) & (events.y < 2))
    frames = open_frames(frames_of(tmp_path / "frames", 6), encoding="linear")
    with pytest.raises(TaskError, match=r"dark level: found \d+ events, .* --dark"):
        fit_recording(few, Evidence(frames=frames))


@pytest.mark.slow
def test_a_shift_of_the_clock_is_not_a_filter(eres, tmp_path):
    """Promise: frames that are stamped 3 ms early, of a sensor without a delay, give a bound of the
    cutoff and no poles, and the sentence with the shift is in the file too; the printed option
    removes the delay."""
    write_events(tmp_path / "recording.h5", moving(0.2, 0.25, 1e-2))
    folder = frames_of(tmp_path / "frames", 6)
    table = folder / "frames.csv"
    head, *rows = table.read_text().splitlines()
    early = [(int(row.split(",")[0]) - 3000, row.split(",")[2]) for row in rows]
    table.write_text("\n".join([head, *(f"{t_us},{t_us},{file}" for t_us, file in early)]))
    given = "fit", tmp_path / "recording.h5", "--frames", folder, "--motion", "--dark", 1e-2
    code, printed, err = eres(*given, "--out", tmp_path / "mine.toml")
    assert (code, err) == (0, "")
    assert re.search(r"cutoff +at least \d+", printed)
    shift = re.search("(a shift of .* filter); .*(--frames-shift-us) (\\d+)", printed)
    assert int(shift[3]) == pytest.approx(3000, abs=100)
    camera = read_camera(tmp_path / "mine.toml")
    bounds = [camera.sources[name] for name in ("cutoff", "latency")]
    assert all(shift[1] in one.text and one.kind == "bound" for one in bounds)
    assert "photoreceptor" not in camera.sources
    assert (camera.cutoff_hz, camera.latency_s) == (math.inf, 0)
    _, printed, _ = eres(*given, *shift.groups()[1:], "--out", tmp_path / "again.toml")
    assert "delay of slow changes: at most " in printed
    assert "a shift of" not in printed


@pytest.mark.parametrize("ends", [(0.0, 0.02), (25.0, math.inf)])
def test_a_bound_is_not_a_value(ends, tmp_path, eres):
    """Promise: an estimate whose interval is open at one end is written and listed as a bound; a
    value that the camera states stays."""
    bound = Estimate(1.0, *ends)
    noise = Noise(bound, bound, bound, bound, np.zeros((4, 4), np.bool_))
    known = EventCamera(leak_hz=0.3)
    write_camera(tmp_path / "mine.toml", Found(noise=noise).camera(known, 'a "b"\\'))
    camera = read_camera(tmp_path / "mine.toml")
    assert replace(camera, name="", shot_noise_exponent=0.5) == known
    bounds = {key: one.interval for key, one in camera.sources.items() if one.kind == "bound"}
    assert bounds == dict.fromkeys(["shot_noise", "hot_pixels", "hot_pixel_rate"], ends)
    _, listed, _ = eres("sensors", tmp_path / "mine.toml")
    rows = re.findall(r"^ *(\w+) .* {:g} to {:g} +bound ".format(*ends), listed, re.MULTILINE)
    assert {*rows} == {*bounds}


def test_steps_and_stillness_are_in_the_camera(tmp_path):
    events, rises_us = flashes(200.0, 2e-4)
    found = fit_recording(events, Evidence(rises_us=rises_us, still_s=(0.0, 0.001)))
    write_camera(tmp_path / "p.toml", found.camera(plain_camera(24), "rec.h5"))
    camera = read_camera(tmp_path / "p.toml")
    assert camera.photoreceptor == "two_pole"
    assert camera.sources["shot_noise_exponent"].interval is None
    assert camera.sources["cutoff"].interval[0] < 200 < camera.sources["cutoff"].interval[1]
    assert "threshold" not in camera.sources


EMPTY = Events(*(np.empty(0, t) for t in ("i8", "u2", "u2", "i1")), width=4, height=4)


@pytest.mark.parametrize(
    ("evidence", "text"),
    [
        ({}, "nothing to fit: give --still, --frames, --crop or --steps"),
        ({"still_s": (1.0, 0.5)}, "still: found 1 to 0.5 s, expected a start"),
        ({"still_s": (0.0, math.inf)}, "still: found 0 to inf s, expected .* a later, finite end"),
        ({"still_s": (-1.0, 0.5)}, "still: found -1 to 0.5 s"),
        ({"light": "light", "dark_share": 0.0}, "dark: found 0, expected a share"),
        ({"still_s": (0.0, 1.0), "dark_share": 0.1}, "--dark needs --f"),
        ({"still_s": (0.0, 1.0), "check": "first"}, "--check needs --f"),
        ({"still_s": (0.0, 1.0), "motion": True}, "--motion needs --frames"),
        ({"frames": "frames", "light": "light"}, "--frames or --crop, not both"),
        ({"still_s": (0.0, 1.0)}, "no events"),
    ],
)
def test_impossible_evidence_is_refused(evidence, text):
    """Promise: one line says what was found and what was expected."""
    with pytest.raises(TaskError, match=text):
        fit_recording(EMPTY, Evidence(**evidence))


def test_a_recording_whose_name_is_not_utf_8_has_a_camera(eres, tmp_path):
    """Promise: the camera has the name with U+FFFD, and the output escapes it."""
    events, _ = still(shot_noise_hz=4.0)
    file = tmp_path / os.fsdecode(b"caf\xe9.npz")
    write_events(file, events)
    out = file.with_suffix(".toml")
    code, printed, err = eres("fit", file, "--out", out, "--still", "0", "1")
    assert (code, err) == (0, "")
    assert "caf\\udce9.toml: " in printed
    camera = read_camera(out)
    assert camera.title == "caf\N{REPLACEMENT CHARACTER}.npz"
    assert camera.sources["shot_noise"].text.startswith(f"{camera.title}: a still stretch")


def test_a_recording_without_events_is_named(eres, tmp_path):
    """Promise: one line with the file, and no camera."""
    file, out = tmp_path / "empty.h5", tmp_path / "mine.toml"
    write_events(file, EMPTY)
    code, _, err = eres("fit", file, "--out", out, "--still", "0", "1")
    assert (code, err.count("\n")) == (1, 1)
    assert f"{file}: has no events" in err
    assert not out.exists()


def test_recordings_that_do_not_show_enough_are_refused(tmp_path):
    """Promise: one line says what was found, with file and line where a time is none."""
    events = moving(0.2, 0.2, 1e-2)
    with pytest.raises(TaskError, match=r"still: found an end of 9 s.* 0\.27"):
        fit_recording(events, Evidence(still_s=(0.0, 9.0)))
    with pytest.raises(TaskError, match="frames have 80x60 px, but the sensor has 81x60 px"):
        levels_of(Events(*events.columns, WIDTH + 1, HEIGHT), light_every(1), 1e-2)
    with pytest.raises(TaskError, match=r"found 0 usable events during .*, expected at least 100"):
        levels_of(events[:9], light_every(1), 1e-2)
    with pytest.raises(TaskError, match="ON events per pixel and step, expected at least 3"):
        fit_response(events, np.array([0, 1000]))
    with pytest.raises(TaskError, match="steps: found 1 step times, expected at least 2"):
        fit_response(events, np.array([0]))
    file = tmp_path / "steps.txt"
    file.write_text("100\n\n2e3 # ON\n")
    assert read_steps(str(file), file).tolist() == [100, 2000]
    for wrong in ("soon", "1e30", "inf"):
        file.write_text(f"100\n{wrong}")
        with pytest.raises(TaskError, match=f"steps.txt:2: found '{wrong}', expected a time in us"):
            read_steps(str(file), file)
    with pytest.raises(TaskError, match=r"none\.txt: no such file"):
        read_steps(str(tmp_path / "none.txt"), file)


def test_steps_are_the_edges_of_one_channel(tmp_path):
    """Promise: edges of a camera's clock on one input are no flashes of the lamp on another."""
    t_us, channel = np.arange(100, 700, 100), np.array([0, 1] * 3, np.uint8)
    edges = Triggers(t_us, channel, np.ones(6, np.int8))
    file = tmp_path / "events.h5"
    write_events(file, moving(0.2, 0.2, 1e-2)[:9], triggers=edges)
    assert read_steps("triggers:1", file).tolist() == [200, 400, 600]
    with pytest.raises(TaskError, match=r"events.h5: triggers: found edges on channels 0, 1;"):
        read_steps("triggers", file)
    with pytest.raises(TaskError, match="channels 0, 1, not on 3"):
        read_steps("triggers:3", file)


def test_steps_in_a_damaged_recording_are_damage(tmp_path):
    """Promise: the error names the file once, and no channel, which cannot help."""
    file = tmp_path / "events.raw"
    edges = Triggers(np.array([100]), np.zeros(1, np.uint8), np.ones(1, np.int8))
    write_events(file, moving(0.2, 0.2, 1e-2)[:9], triggers=edges)
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(EventFormatError) as error:
        read_steps("triggers", file)
    assert str(error.value).count(str(file)) == 1
    assert "--steps" not in str(error.value)


@given(st.integers(0, 2000), st.integers(1, 50))
def test_a_longer_stretch_narrows_the_interval(count, times):
    """Promise: the interval holds the estimate, and shrinks with the number of events."""
    once, often = poisson_rate(count, 1.0), poisson_rate(count * times, float(times))
    assert once.low <= once.value <= once.high
    assert often.high - often.low <= once.high - once.low + 1e-9


def test_nothing_asked_nothing_found():
    assert Found().values("x") == {}
