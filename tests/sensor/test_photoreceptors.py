"""The kinds of photoreceptor, separate thresholds for ON and OFF, and latency."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import reference_sensor
from exact_sensor import Pixel, exact_events
from sensor import SensorError, SensorModel, simulate, simulate_bank, stream
from sensor.formats.header import model_from_json, model_to_json

WHITE = 2.0
V2E = SensorModel(
    width=1,
    height=1,
    contrast_threshold=0.05,
    cutoff_hz=100.0,
    dark_level=1e-3,
    photoreceptor="v2e",
    cutoff_reference=WHITE,
)


@pytest.mark.parametrize("gray", [0.0, 20.0, 128.0, 255.0])
def test_v2e_has_the_published_cutoff_in_constant_light(gray):
    """Physics: after a step of the light the response is 1 - e^{-a t}, with a cutoff of (v + 20)
    / 275 for a gray value v of the new light. Source: v2e, `rescale_intensity_frame`."""
    dark, step = V2E.dark_level, 0.98
    after = gray / 255 * WHITE
    before = (after + dark) * math.exp(step) - dark
    light = np.array([before, after, after])[:, None, None]
    events = simulate(light, [0.0, 1e-9, 3.0], V2E)
    a = 2 * math.pi * V2E.cutoff_hz * (gray + 20) / 275
    levels = np.arange(1, 20) * V2E.contrast_threshold
    expected = -np.log1p(-levels / step) / a * 1e6
    assert len(events) == len(levels)
    assert np.all(events.p == -1)
    np.testing.assert_allclose(events.t_us, expected, atol=1)


def test_v2e_matches_a_slow_reference():
    """Promise: v2e's filter with the cutoff held between frames, event by event within 1 us."""
    rng = np.random.default_rng(3)
    t_s = np.cumsum(rng.uniform(1e-4, 2e-2, 30))
    light = WHITE * np.clip(np.exp(rng.normal(-1.5, 0.6, 30)), 0, 1)
    u = np.log(light + V2E.dark_level)
    middle = np.exp(0.5 * (u[1:] + u[:-1])) - V2E.dark_level
    cutoffs_hz = [reference_sensor.v2e_cutoff_hz(one, WHITE, V2E.cutoff_hz) for one in middle]
    expected = reference_sensor.pixel_events(
        u.tolist(), t_s.tolist(), V2E.contrast_threshold, cutoffs_hz, poles=1
    )
    events = simulate(light[:, None, None], t_s, V2E)
    assert len(events) > 50
    assert events.p.tolist() == [p for _, p in expected]
    np.testing.assert_allclose(events.t_us, [1e6 * t for t, _ in expected], atol=1)


@pytest.mark.parametrize("cutoff_hz", [math.inf, 150.0])
@pytest.mark.parametrize("v2e", [False, True])
def test_thresholds_apart_are_exact(cutoff_hz, v2e):
    """Promise: with a separate threshold for OFF, every event is that of 200-bit arithmetic."""
    if v2e and cutoff_hz == math.inf:
        return  # no filter
    rng = np.random.default_rng(5)
    t_s = np.arange(12) * 3e-3
    light = np.exp(rng.normal(0, 0.5, (12, 20)))
    pixel = Pixel(0.11, cutoff_hz, 1 if v2e else 2, 0.0, 0.01, WHITE if v2e else None, v2e, 0.17)
    model = SensorModel(
        width=20,
        height=1,
        contrast_threshold=0.11,
        contrast_threshold_off=0.17,
        cutoff_hz=cutoff_hz,
        dark_level=0.01,
        photoreceptor="v2e" if v2e else "two_pole",
        cutoff_reference=WHITE if v2e else None,
    )
    events = simulate(light[:, None, :], t_s, model)
    for x in range(20):
        exact = exact_events(light[:, x], t_s, pixel)
        assert events.p[events.x == x].tolist() == exact.p
        np.testing.assert_allclose(
            events.t_us[events.x == x], [float(t) for t in exact.t_us], atol=1
        )
    assert (events.p == 1).sum() > (events.p == -1).sum() > 50


def held_cutoff_error_us(intervals: int) -> float:
    """Return the largest error of an event's time, where the light rises from a hundredth of white
    to white within 20 ms, divided into `intervals` frame intervals."""
    length_s, start = 0.02, 0.01
    u0, slope = math.log(start * WHITE), -math.log(start) / length_s

    def derivative(t, v):
        u = u0 + slope * t
        gray = 255 * math.exp(u) / WHITE
        return 2 * math.pi * V2E.cutoff_hz * (gray + 20) / 275 * (u - v)

    model = replace(V2E, dark_level=0.0)
    t_s = np.linspace(0, length_s, intervals + 1)
    events = simulate(np.exp(u0 + slope * t_s)[:, None, None], t_s, model)
    times = events.t_us * 1e-6
    true = solve_ivp(derivative, (0, length_s), [u0], t_eval=times, rtol=1e-11, atol=1e-12).y[0]
    levels = u0 + V2E.contrast_threshold * np.arange(1, len(times) + 1)
    speeds = np.array([derivative(t, v) for t, v in zip(times, true, strict=True)])
    return float(1e6 * np.abs((true - levels) / speeds).max())


def test_the_error_of_the_held_cutoff_falls_with_the_square_of_the_step():
    """Promise: halving the step divides the error by about four, as docs/physics.md says."""
    errors_us = [held_cutoff_error_us(intervals) for intervals in (10, 20, 40)]
    assert errors_us[0] < 200
    for coarse, fine in pairwise(errors_us):
        assert 3 < coarse / fine < 5.5


def test_white_is_that_of_the_first_frame_by_default():
    """Promise: without a reference white is the 99.9th percentile; a black frame is refused, as for
    the dark level."""
    light = np.stack([np.full((4, 5), 0.5), np.full((4, 5), 2.0)])
    model = SensorModel(width=5, height=4, cutoff_hz=50.0, photoreceptor="v2e")
    events = simulate(light, [0.0, 0.1], model)
    assert events.model.cutoff_reference == 0.5
    given = replace(model, cutoff_reference=0.5, dark_level=5e-4)
    np.testing.assert_array_equal(events.t_us, simulate(light, [0.0, 0.1], given).t_us)
    with pytest.raises(SensorError, match=r"cutoff_reference: .* is black"):
        simulate(0 * light, [0.0, 0.1], replace(model, dark_level=1e-3))


def test_without_a_cutoff_all_photoreceptors_are_the_ideal_pixel():
    light = np.exp(np.random.default_rng(0).normal(0, 1, (6, 5, 7)))
    ideal = SensorModel(width=7, height=5)
    kinds = [replace(ideal, photoreceptor=kind) for kind in ("two_pole", "one_pole", "v2e")]
    first, *rest = simulate_bank(light, np.arange(6) * 0.01, kinds)
    for events in rest:
        np.testing.assert_array_equal(events.t_us, first.t_us)


def test_latency_delays_every_event():
    """Promise: all times are later by the latency, rounded once; nothing else changes."""
    light = np.exp(np.random.default_rng(1).normal(0, 1, (30, 5, 7)))
    t_s = np.arange(30) * 1e-3
    model = SensorModel(width=7, height=5, cutoff_hz=300.0, refractory_s=3e-4)
    late = replace(model, latency_s=1234.4e-6)
    one, other = simulate(light, t_s, model), simulate(light, t_s, late)
    np.testing.assert_array_equal(other.t_us, one.t_us + 1234)
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))
    streamed = np.concatenate([part.t_us for part in stream(light, t_s, late)])
    np.testing.assert_array_equal(streamed, other.t_us)


def test_files_of_older_versions_keep_their_photoreceptor():
    """Promise: "poles" of older files is read as the photoreceptor; new ones store its name."""
    text = model_to_json(SensorModel(width=3, height=2, cutoff_hz=50.0))
    old = text.replace('"photoreceptor": "two_pole"', '"poles": 1')
    assert model_from_json(old).photoreceptor == "one_pole"
    assert model_from_json(text.replace('"photoreceptor": "two_pole"', '"poles": 2')).poles == 2
    assert model_from_json(model_to_json(V2E)) == V2E
