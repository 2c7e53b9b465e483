"""Pixel realism: each part against its closed-form statistics; all of it is off by default."""

import math

import numpy as np
import pytest
from scipy import stats

import reference_sensor
from sensor import SensorError, SensorModel, cutoff_in_light, simulate
from sensor.optics import integrate

SIDE = 60
PIXELS = SIDE * SIDE


def constant(light, seconds, frames=11):
    """Return frames of constant light, and their times."""
    light = np.broadcast_to(np.asarray(light, dtype=np.float64), (SIDE, SIDE))
    return np.broadcast_to(light, (frames, SIDE, SIDE)), np.linspace(0, seconds, frames)


def ramp(per_second, seconds, frames=11):
    """Return uniform light with a logarithm that rises linearly."""
    t_s = np.linspace(0, seconds, frames)
    return np.exp(per_second * t_s)[:, None, None] * np.ones((1, SIDE, SIDE)), t_s


def model(**kwargs):
    return SensorModel(width=SIDE, height=SIDE, **{"dark_level": 0.01, **kwargs})


def counts(events, polarity=None):
    """Return the (SIDE, SIDE) number of events per pixel, of one polarity or both."""
    chosen = slice(None) if polarity is None else events.p == polarity
    pixel = events.y[chosen].astype(int) * SIDE + events.x[chosen]
    return np.bincount(pixel, minlength=PIXELS).reshape(SIDE, SIDE)


def test_defaults_are_the_noiseless_pixel():
    """Promise: all effects in this file are off by default."""
    assert len(simulate(*constant(0.5, 10.0), model())) == 0


@pytest.mark.parametrize("cutoff_hz", [math.inf, 50.0])
def test_leak_fires_on_events_at_its_rate(cutoff_hz):
    """Physics: in constant light a leaking pixel fires ON every 1 / leak_hz, with any filter."""
    events = simulate(*constant(0.5, 3.05), model(leak_hz=10.0, cutoff_hz=cutoff_hz))
    assert np.all(events.p == 1)
    assert np.all(counts(events) == 30)
    np.testing.assert_allclose(np.unique(events.t_us), np.arange(1, 31) * 100_000, atol=1)


def test_leak_with_random_start_has_its_mean_rate():
    """Physics: with distributed memories, each microsecond is equally likely."""
    events = simulate(*constant(0.5, 2.03), model(leak_hz=1.0, random_start=True))
    late = events.between(1_000_000, 2_000_000)  # from then on all pixels are in their rhythm
    assert len(late) == PIXELS
    assert stats.kstest(late.t_us, stats.uniform(1e6, 1e6).cdf).pvalue > 0.001


@pytest.mark.parametrize("cutoff_hz", [math.inf, 50.0])
def test_random_start_keeps_within_each_pixels_own_thresholds(cutoff_hz):
    """Physics: the memory of a running pixel lies within its thresholds, so nothing fires at once.

    In constant light it never fires, even with small thresholds.
    """
    drawn = model(random_start=True, threshold_mismatch=0.1, cutoff_hz=cutoff_hz)
    assert len(simulate(*constant(0.5, 0.1), drawn)) == 0


def test_threshold_mismatch_is_a_fixed_pattern_of_its_spread():
    """Physics: thresholds are normal around C, ON and OFF independently, and constant per pixel."""
    C, sigma, height = 0.2, 0.02, 40.0
    rise, t_s = ramp(height, 1.0)
    noisy = model(contrast_threshold=C, threshold_mismatch=sigma, dark_level=0.0)
    up = simulate(rise, t_s, noisy, seed=3)
    down = simulate(rise[::-1], t_s, noisy, seed=3)
    C_on, C_off = height / (counts(up) + 0.5), height / (counts(down) + 0.5)
    for seen in (C_on, C_off):
        assert abs(seen.mean() - C) < 4 * sigma / SIDE + C**2 / height
        assert seen.std() == pytest.approx(sigma, rel=0.06)
    assert abs(np.corrcoef(C_on.ravel(), C_off.ravel())[0, 1]) < 4 / SIDE
    again = simulate(rise, t_s, noisy, seed=3, threads=1)
    np.testing.assert_array_equal(counts(again), counts(up))
    assert not np.array_equal(counts(simulate(rise, t_s, noisy, seed=4)), counts(up))


def test_shot_noise_is_a_poisson_process():
    """Physics: counts have the variance of their mean, over any window, for both polarities."""
    rate_hz, seconds = 8.0, 5.0
    dark = constant(0.0, seconds, frames=7)
    events = simulate(*dark, model(shot_noise_hz=rate_hz), seed=1)
    per_pixel = counts(events)
    mean = rate_hz * seconds
    assert abs(per_pixel.mean() - mean) < 4 * math.sqrt(mean) / SIDE
    assert per_pixel.var() == pytest.approx(mean, rel=4 * math.sqrt(2) / SIDE)
    assert abs((events.p == 1).mean() - 0.5) < 2 / math.sqrt(len(events))
    assert stats.kstest(events.t_us[::10], stats.uniform(0, seconds * 1e6).cdf).pvalue > 0.001
    window = (events.t_us // 50_000).clip(max=99)  # much shorter than a frame interval
    cell = (events.y.astype(int) * SIDE + events.x) * 100 + window
    in_windows = np.bincount(cell, minlength=PIXELS * 100)
    assert in_windows.var() / in_windows.mean() == pytest.approx(1, abs=4 * math.sqrt(2e-2) / SIDE)


@pytest.mark.parametrize("interval_s", [0.5, 0.7, 8.0])
def test_noise_over_long_intervals_is_a_poisson_process_too(interval_s):
    """Physics: counts, times and signs of a Poisson process of any mean between two frames."""
    rate_hz = 100.0
    events = simulate(*constant(0.0, interval_s, frames=2), model(shot_noise_hz=rate_hz), seed=2)
    per_pixel, mean = counts(events), rate_hz * interval_s
    assert abs(per_pixel.mean() - mean) < 4 * math.sqrt(mean) / SIDE
    assert per_pixel.var() == pytest.approx(mean, rel=4 * math.sqrt(2) / SIDE)
    assert abs((events.p == 1).mean() - 0.5) < 2 / math.sqrt(len(events))
    few = events.t_us[:: len(events) // 20_000]
    assert stats.kstest(few, stats.uniform(0, interval_s * 1e6).cdf).pvalue > 0.001


def test_shot_noise_falls_with_the_light():
    """Physics: a hundred times the light, a tenth of the noise (exponent 1/2)."""
    light = np.where(np.arange(SIDE) < SIDE // 2, 0.0, 99 * 0.01)
    events = simulate(*constant(light, 20.0), model(shot_noise_hz=5.0))
    left, right = np.split(counts(events), 2, axis=1)
    assert left.sum() / right.sum() == pytest.approx(10, rel=0.05)


@pytest.mark.parametrize("u_end", [math.log(100.0), -math.log(100.0), math.log(1e20), 1e-5])
def test_shot_noise_follows_light_that_changes_between_frames(u_end):
    """Analytic: log light is linear in time, so the rate is exponential; counts have its integral,
    times its course, over one interval of any length and change."""
    dark, rate_hz, exponent, seconds = 0.01, 20.0, 0.5, 10.0
    u = np.array([max(-u_end, 0.0), max(u_end, 0.0)])  # above log(dark)
    frames = (dark * np.exp(u) - dark)[:, None, None] * np.ones((1, SIDE, SIDE))
    quiet = {"contrast_threshold": 1e3, "dark_level": dark, "shot_noise_exponent": exponent}
    events = simulate(frames, [0.0, seconds], model(shot_noise_hz=rate_hz, **quiet), seed=4)
    rates_hz = rate_hz * np.exp(-exponent * u)
    fall = -exponent * u_end  # of the logarithm of the rate
    mean = (rates_hz[1] - rates_hz[0]) / fall * seconds
    assert abs(counts(events).mean() - mean) < 4 * math.sqrt(mean) / SIDE
    assert counts(events).var() == pytest.approx(mean, rel=4 * math.sqrt(2 + 1 / mean) / SIDE)

    def course(t_us):
        return np.expm1(fall * t_us * 1e-6 / seconds) / np.expm1(fall)

    few = events.t_us[:: max(len(events) // 20_000, 1)]
    assert stats.kstest(few, course).pvalue > 0.001


@pytest.mark.parametrize("seeds", [(0, 1), (2, 3), (0, 4095), (0, 1 << 40)])
@pytest.mark.parametrize("noise", [{"shot_noise_hz": 8.0}, {"hot_pixel_fraction": 1.0}])
def test_another_seed_gives_other_noise_and_not_the_same_at_other_pixels(seeds, noise):
    """Promise: repetitions are independent, also over the whole sensor: their times and numbers of
    events are as different as chance makes them."""
    noisy = model(**{"hot_pixel_hz": 8.0, **noise})
    one, other = (simulate(*constant(0.0, 1.0, 2), noisy, seed=seed) for seed in seeds)
    common = len(np.intersect1d(one.t_us, other.t_us))
    by_chance = 1e6 * math.prod(-math.expm1(-len(events) / 1e6) for events in (one, other))
    assert abs(common - by_chance) < 5 * math.sqrt(by_chance)
    assert len(one) != len(other)


def test_noise_does_not_move_the_signal(scene_in_motion):
    """Physics: noise adds events; those of the light do not change."""
    frames, t_s = scene_in_motion
    clean = simulate(frames, t_s, model(cutoff_hz=200.0))
    noisy = simulate(frames, t_s, model(cutoff_hz=200.0, shot_noise_hz=300.0))
    columns = ("t_us", "y", "x", "p")
    as_set = [
        set(zip(*(getattr(e, c).tolist() for c in columns), strict=True)) for e in (clean, noisy)
    ]
    assert as_set[0] < as_set[1]
    assert len(noisy) > len(clean) + 100
    key = noisy.t_us * 10_000 + noisy.y.astype(np.int64) * 100 + noisy.x
    assert np.all(np.diff(key) >= 0)


@pytest.fixture
def scene_in_motion():
    t_s = np.arange(30) * 1e-3
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    return 1.2 + np.sin(20 * (x + y) + 200 * t_s[:, None, None]), t_s


def test_draws_depend_neither_on_threads_nor_on_chunks(scene_in_motion):
    """Promise: one seed gives one set of events, for any division of the work."""
    frames, t_s = scene_in_motion
    everything = model(
        cutoff_hz=300.0,
        threshold_mismatch=0.03,
        leak_hz=5.0,
        shot_noise_hz=200.0,
        hot_pixel_fraction=0.01,
        hot_pixel_hz=500.0,
        refractory_s=5e-4,
        random_start=True,
    )
    one = simulate(frames, t_s, everything, seed=9, threads=1)
    many = simulate((f for f in frames), t_s, everything, seed=9, threads=4)
    for column in ("t_us", "x", "y", "p"):
        np.testing.assert_array_equal(getattr(one, column), getattr(many, column))


def test_hot_pixels_are_few_and_fire_at_their_rate():
    """Physics: the share of hot pixels is binomial, their events Poisson, in any light."""
    share, rate_hz, seconds = 0.05, 40.0, 2.0
    noisy = model(hot_pixel_fraction=share, hot_pixel_hz=rate_hz)
    per_pixel = counts(simulate(*constant(3.0, seconds), noisy))
    hot = per_pixel > 0
    assert abs(hot.sum() - share * PIXELS) < 4 * math.sqrt(share * PIXELS)
    mean = rate_hz * seconds
    assert abs(per_pixel[hot].mean() - mean) < 4 * math.sqrt(mean / hot.sum())


def test_refractory_loses_reports_but_not_the_measurement():
    """Promise: no two events of a pixel are closer than the period; the others keep their times."""
    rise, t_s = ramp(100.0, 0.5)  # an event every 2 ms
    free = simulate(rise, t_s, model(dark_level=0.0))
    tired = simulate(rise, t_s, model(dark_level=0.0, refractory_s=3e-3))
    one, other = (np.unique(e.t_us) for e in (free, tired))
    np.testing.assert_array_equal(other, one[::2])
    assert np.diff(other).min() >= 3000


@pytest.mark.parametrize("cutoff_hz", [200.0, 50.0])
def test_one_pole_answers_as_one_pole(cutoff_hz):
    """Physics: a unit step gives 1 - e^{-a t}; a ramp lags by a single 1/a."""
    a = 2 * math.pi * cutoff_hz
    one = SensorModel(
        width=1, height=1, cutoff_hz=cutoff_hz, dark_level=0.0, photoreceptor="one_pole"
    )
    step = np.exp([0.0, 1.0, 1.0, 1.0])[:, None, None]
    y = a * simulate(step, [0.0, 1e-9, 0.01, 0.2], one).t_us * 1e-6
    np.testing.assert_allclose(1 - np.exp(-y), [0.2, 0.4, 0.6, 0.8], atol=a * 1e-6)
    t_s = np.arange(0, 0.3, 2e-3)
    rise = simulate(np.exp(50 * t_s)[:, None, None], t_s, one).t_us
    late = rise > 15e6 / a
    expected = np.arange(1, len(rise) + 1) * 0.2 / 50 * 1e6 + 1e6 / a
    np.testing.assert_allclose(rise[late], expected[late], atol=0.6)


def test_cutoff_in_proportion_to_the_light():
    """Physics: ten times the light gives ten times the bandwidth, so a small step is ten times
    faster.

    The step is 2 % in light; C is so small that it crosses several levels.
    """
    C, dark, reference = 0.004, 1e-6, 1.0
    levels = np.array([0.1, 1.0])
    frames = np.stack([levels, levels * math.exp(0.02), levels * math.exp(0.02)])[:, None, :]
    follows = SensorModel(
        width=2,
        height=1,
        contrast_threshold=C,
        cutoff_hz=200.0,
        cutoff_reference=reference,
        dark_level=dark,
    )
    events = simulate(np.concatenate((frames, frames[-1:])), [0.0, 1e-9, 0.01, 1.0], follows)
    for x, light in enumerate(levels):
        a = 2 * math.pi * 200.0 * light
        y = a * events.t_us[events.x == x] * 1e-6
        got = 0.02 * (1 - (1 + y) * np.exp(-y))
        np.testing.assert_allclose(got, np.arange(1, 5) * C, rtol=0.03)


def test_illuminance_sets_the_cutoff():
    """Physics: a kilolux gives the DVS128's published 3 kHz, and half the light gives half of
    it."""
    assert cutoff_in_light(1000.0) == pytest.approx(3000.0)
    assert cutoff_in_light(500.0) == pytest.approx(1500.0)
    with pytest.raises(SensorError, match="illuminance_lux: found 0"):
        cutoff_in_light(0)


def test_fill_factor_sees_the_middle_of_each_pixel():
    """Physics: a pixel with fill factor 1/4 averages a square of half its side, in its center."""
    rng = np.random.default_rng(0)
    frame = rng.gamma(1.0, 1.0, (24, 36))
    middles = frame.reshape(6, 4, 9, 4)[:, 1:3, :, 1:3].mean(axis=(1, 3))
    np.testing.assert_allclose(integrate(frame, 6, 9, 0.25), middles, rtol=1e-12)
    np.testing.assert_allclose(
        integrate(frame, 7, 5, 1.0), reference_sensor.area_mean(frame, 7, 5), rtol=1e-12
    )
    half_blind = SensorModel(width=9, height=6, fill_factor=0.25, dark_level=0.0)
    events = simulate(np.stack([np.ones_like(frame), frame]), [0.0, 1.0], half_blind)
    np.testing.assert_array_equal(events.polarity_sum(), np.trunc(np.log(middles) / 0.2))


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ({"photoreceptor": "three_pole"}, "photoreceptor"),
        ({"contrast_threshold_off": 0.0}, "contrast_threshold_off"),
        ({"latency_s": -1e-6}, "latency_s"),
        ({"cutoff_reference": 1.0}, "cutoff_reference"),
        ({"fill_factor": 1e-9}, "fill_factor"),
        ({"threshold_mismatch": -0.1}, "threshold_mismatch"),
        ({"leak_hz": math.inf}, "leak_hz"),
        ({"shot_noise_hz": 1.0, "dark_level": 0.0}, "shot_noise_hz"),
        ({"hot_pixel_fraction": 1.5}, "hot_pixel_fraction"),
        ({"refractory_s": math.nan}, "refractory_s"),
    ],
)
def test_impossible_electronics_are_refused(kwargs, text):
    """Promise: an error names a number out of range, what was found and what was expected."""
    with pytest.raises(SensorError, match=f"SensorModel.{text}: found"):
        model(**kwargs)
