"""Events at any frame interval, cutoff, leak and time, against bisection in 200-bit arithmetic.

The draws cover every valid input, not only our own studies: dt, the frame interval in time
constants of the photoreceptor, is between 1e-9 and 1e6.
"""

import math
from collections import Counter

import numpy as np
import pytest

from drawn_sensors import PIXELS, drawn, is_too_near, row_of
from exact_sensor import exact_events
from sensor import SensorError, SensorModel, simulate, simulate_bank


def compare(seed):
    """Compare the pixels of one drawn sensor: a `Counter` of "right", "too near" and "wrong"."""
    kind, radiance, t_s, pixel = drawn(seed)
    model = row_of(pixel)
    events = simulate(radiance[:, None, :], t_s, model, threads=1)
    assert np.all(np.diff(events.t_us) >= 0)
    outcome = Counter()
    for x in range(PIXELS):
        exact = exact_events(radiance[:, x], t_s, pixel)
        mine = events.x == x
        t_us, p = events.t_us[mine], events.p[mine]
        right = p.tolist() == exact.p and all(
            abs(int(ours) - theirs) <= 1 for ours, theirs in zip(t_us, exact.t_us, strict=True)
        )
        if is_too_near(exact):
            outcome["too near"] += 1
        elif right:
            outcome["right"] += 1
            outcome["events"] += len(p)
        else:
            outcome["wrong"] += 1
            print(f"seed {seed} ({kind}), pixel {x}: {pixel}, intervals {np.diff(t_s)} s")
    return outcome


def check(seeds):
    total = sum((compare(seed) for seed in seeds), Counter())
    pixels = len(seeds) * PIXELS
    print(dict(total), f"of {pixels} pixels")
    assert total["wrong"] == 0
    assert total["too near"] < 0.05 * pixels
    assert total["events"] > pixels


def test_pixels_are_exact_at_any_interval():
    """Promise: count, polarity and order of every event are exact, and its time within 1 us, for
    any frame interval, cutoff, leak and clock. The exceptions are voltages that come within 1e-12
    of a level without crossing it, or need a microsecond for such a distance."""
    check(range(35))  # five of each kind of electronics


@pytest.mark.slow
@pytest.mark.parametrize("part", range(10))
def test_a_hundred_thousand_pixels_are_exact_at_any_interval(part):
    """The same for more pixels, in ten parts."""
    check(range(1000 + 500 * part, 1500 + 500 * part))


def one_pixel(u, t_s, seed=0, **electronics):
    """Return the events of a pixel with log intensity u at the times."""
    frames = np.exp(np.asarray(u, dtype=np.float64))[:, None, None]
    model = SensorModel(width=1, height=1, **{"dark_level": 0.0} | electronics)
    return simulate(frames, t_s, model, seed=seed, threads=1)


@pytest.mark.parametrize("still_s", [0.05, 0.5, 50.0, 2000.0])
def test_a_step_before_a_long_still_interval_has_its_own_times(still_s):
    """Physics: after a unit step v2 = 1 - (1 + y) e^{-y}, y = a t, however long the pause after
    it."""
    events = one_pixel([0.0, 1.0, 1.0], [0.0, 1e-9, still_s], cutoff_hz=200.0)
    y = 2 * math.pi * 200.0 * events.t_us * 1e-6
    assert events.p.tolist() == [1, 1, 1, 1]
    np.testing.assert_allclose(1 - (1 + y) * np.exp(-y), [0.2, 0.4, 0.6, 0.8], atol=1e-3)


def test_a_cutoff_beyond_any_circuit_is_an_ideal_pixel():
    """Physics: a filter without a lag changes nothing, even where 2 pi f_cutoff overflows."""
    rng = np.random.default_rng(0)
    u, t_s = np.cumsum(rng.normal(0, 0.3, 40)), np.arange(40) * 1e-3
    ideal = one_pixel(u, t_s)
    for cutoff_hz in (1e15, 1e308):
        fast = one_pixel(u, t_s, cutoff_hz=cutoff_hz)
        np.testing.assert_array_equal(fast.p, ideal.p)
        assert np.abs(fast.t_us - ideal.t_us).max() <= 1
    assert len(one_pixel(u, t_s, cutoff_hz=1e-300)) == 0


@pytest.mark.parametrize("start_s", [0.0, 0.5e-6, 1.6e9 + 0.5e-6, 4.6e9, -4.6e9, 9e12])
@pytest.mark.parametrize("interval_s", [1e-3, 1 / 30])
def test_leak_levels_that_fall_on_frame_times_are_each_met_once(start_s, interval_s):
    """Physics: a leak fires at equal intervals, also at frame times, which float64 then only has
    approximately; no event is lost, doubled, or out of order."""
    t_s = start_s + np.arange(41) * (interval_s if abs(start_s) < 1e12 else 1.0)
    period_s = 4 * (t_s[1] - t_s[0])
    lights = np.append(np.linspace(0.1, 9, 200), 2.606532663316583)
    model = SensorModel(width=lights.size, height=1, dark_level=0.0, leak_hz=1 / period_s)
    events = simulate(np.tile(lights, (41, 1, 1)), t_s, model, threads=1)
    assert np.all(np.diff(events.t_us) >= 0)
    since_us = (events.t_us - math.floor(start_s) * 1_000_000) - (start_s % 1) * 1e6
    resolution_us = np.spacing(abs(t_s[-1])) * 1e6 * 41
    for x in range(lights.size):
        mine = since_us[events.x == x]
        assert mine.size in (9, 10)  # the tenth falls on the last frame
        expected_us = np.arange(1, mine.size + 1) * period_s * 1e6
        assert np.all(np.abs(mine - expected_us) <= 1 + resolution_us)


@pytest.mark.parametrize(
    ("t_s", "speed", "expected"),
    [
        ([0.0, 1e13], 1.0, r"t_s\[1\]: found 1e\+13 s"),
        ([-1e13, 0.0], 1.0, r"t_s\[0\]: found -1e\+13 s"),
        ([0.0, 2000.0], 0.5, "4000 s apart at speed 0.5"),
        ([0.0, 1.0], 1e-13, r"found 1e\+13 s at speed 1e-13"),
        ([0.0, 1e-3], 1e321, "positive factors"),
        ([1.9, math.nextafter(1.9, 2)], 1.8, "0 s apart at speed 1.8"),
    ],
)
def test_times_without_microseconds_are_refused(t_s, speed, expected):
    """Promise: an error names times that int64 microseconds cannot store; they never wrap."""
    model = SensorModel(width=1, height=1, dark_level=0.0)
    with pytest.raises(SensorError, match=expected):
        simulate_bank(np.ones((2, 1, 1)), t_s, [model], speeds=[speed])


@pytest.mark.parametrize("light", [0.0, 5e-324, 1e-310])
def test_light_below_what_float64_holds_is_refused_without_a_dark_level(light):
    """Promise: the sensor refuses a logarithm without correct digits; a dark level restores
    them."""
    frames = np.array([1.0, light])[:, None, None]
    with pytest.raises(SensorError, match=r"frame 1, pixel x=0 y=0: found radiance .*dark_level"):
        simulate(frames, [0.0, 1e-3], SensorModel(width=1, height=1, dark_level=0.0))
    assert len(simulate(frames, [0.0, 1e-3], SensorModel(width=1, height=1, dark_level=0.01))) == 23


def test_the_least_light_of_float64_has_its_events():
    """Physics: log intensity is exact down to the least normal number."""
    u = [math.log(2.3e-308), math.log(2.3e-308) + 1.01]
    assert len(one_pixel(u, [0.0, 1e-3])) == 5
