"""Promises of `simulate` beyond one pixel: order, determinism, streaming, clear errors."""

import dataclasses
import math

import numpy as np
import pytest

from event_streams import COLUMNS, assert_same
from moving_texture import texture_in_motion
from sensor import EventError, Events, SensorError, SensorModel, simulate, simulate_bank, stream
from sensor.engine import devices, group, workers
from sensor.levels import white_level


@pytest.fixture(scope="module")
def scene():
    return texture_in_motion(0, 25, (48, 48), 1e-3, travel_px=24.0)


def model(size=48, cutoff_hz=200.0, **kwargs):
    return SensorModel(width=size, height=size, cutoff_hz=cutoff_hz, **kwargs)


@pytest.mark.parametrize("cutoff_hz", [math.inf, 50.0])
def test_identical_for_any_threads_and_chunks(scene, monkeypatch, cutoff_hz):
    """Promise: threads, chunks and blocks change no bit."""
    frames, t_s = scene
    expected = simulate(frames, t_s, model(cutoff_hz=cutoff_hz), threads=1)
    assert len(expected) > 5000
    for threads, chunk, block in [(2, 8, 512), (3, 1, 7), (5, 3, 100), (1, 12, 5000)]:
        monkeypatch.setattr(devices, "_CHUNK_FRAMES", chunk)
        monkeypatch.setattr(group, "_BLOCK_PX", block)
        got = simulate(iter(frames), t_s, model(cutoff_hz=cutoff_hz), threads=threads)
        assert_same(got, expected)


@pytest.mark.parametrize(
    "electronics",
    [{}, {"cutoff_hz": 200.0}, {"cutoff_hz": 200.0, "shot_noise_hz": 500.0, "leak_hz": 50.0}],
)
def test_a_full_pool_grows_and_loses_nothing(monkeypatch, electronics):
    """Promise: if the initial pools are too small, no event is lost, doubled or moved."""
    frames = np.exp(np.random.default_rng(0).normal(0, 1, (5, 64, 64)))
    fine = model(64, math.inf, dark_level=1e-3, contrast_threshold=0.02)
    fine = dataclasses.replace(fine, **electronics)
    t_s = np.arange(5) * 1e-3
    expected = simulate(frames, t_s, fine, threads=1)
    monkeypatch.setattr(workers, "_POOL_EVENTS", 256)
    assert len(expected) > 100 * 256
    assert_same(simulate(frames, t_s, fine, threads=2), expected)


def test_a_step_of_many_thresholds_fires_one_event_for_each():
    """Analytic: a pixel that brightens and darkens again crosses floor(step / C) levels twice."""
    frames = np.full((3, 16, 16), 1e-6)
    frames[1] = np.exp(np.random.default_rng(0).uniform(-10, 10, (16, 16)))
    t_s = [0.0, 1e-3, 2e-3]
    fine = SensorModel(width=16, height=16, contrast_threshold=0.01, dark_level=1e-9)
    events = simulate(frames, t_s, fine)
    rise = np.floor(np.log((frames[1] + 1e-9) / (1e-6 + 1e-9)) / 0.01)
    ups, downs = np.zeros((2, 16, 16))
    for turns, polarity in ((ups, 1), (downs, -1)):
        of = events.p == polarity
        np.add.at(turns, (events.y[of], events.x[of]), 1)
    np.testing.assert_array_equal(ups, rise)
    # Down again, except for the last threshold's width where the start is a level.
    assert np.all((downs == rise) | (downs == rise - 1))


@pytest.mark.parametrize("interval_s", [3e-7, 1e-3, 7e-3])
def test_sorted_by_time_row_column(interval_s):
    """Promise: output is sorted by time, ties by (y, x), also where frames share a microsecond."""
    frames, t_s = texture_in_motion(0, 25, (48, 48), interval_s, travel_px=24.0)
    events = simulate(frames, 1.0 + t_s, model(cutoff_hz=math.inf), threads=2)
    key = events.t_us * 10_000 + events.y.astype(np.int64) * 100 + events.x
    assert np.all(np.diff(key) >= 0)
    Events(events.t_us, events.x, events.y, events.p, 48, 48)  # passes its own checks


def test_stream_is_simulate_in_parts(scene):
    """Promise: the parts form the whole, in order, for any source of frames."""
    frames, t_s = scene
    parts = list(stream((f for f in frames), t_s, model()))
    assert len(parts) > 2
    whole = simulate(frames, t_s, model())
    for column in COLUMNS:
        joined = np.concatenate([getattr(part, column) for part in parts])
        np.testing.assert_array_equal(joined, getattr(whole, column))


def test_bank_equals_single_runs(scene):
    """Promise: sharing frames among sizes, cutoffs and speeds changes no event."""
    frames, t_s = scene
    models = [model(s, c) for s in (48, 13, 30) for c in (math.inf, 200.0, 50.0)]
    models.append(model(13, 50.0, contrast_threshold=0.1, random_start=True, dark_level=0.5))
    models += [model(30, math.inf, leak_hz=3.0), model(30, math.inf, refractory_s=2e-3)]
    models += [model(30, math.inf, shot_noise_hz=50.0), model(30, math.inf, random_start=True)]
    speeds = [1.0, 4 / 3, 2.0] * 3 + [1.0, 0.5, 0.7, 3.0, 2.0]
    together = simulate_bank(frames, t_s, models, speeds=speeds)
    for m, speed, events in zip(models, speeds, together, strict=True):
        assert_same(events, simulate(frames, t_s / speed, m))
        assert (events.width, events.model.cutoff_hz) == (m.width, m.cutoff_hz)


def test_a_model_of_a_bank_starts_at_its_own_frame(scene, monkeypatch):
    """Promise: what is simulated beside a model, and the frames before its first, change no event,
    noise included."""
    frames, t_s = scene
    rng = np.random.default_rng(1)
    electronics = [
        {"cutoff_hz": math.inf},
        {"cutoff_hz": 50.0, "random_start": True},
        {"cutoff_hz": 200.0, "shot_noise_hz": 400.0, "leak_hz": 20.0},
        {"cutoff_hz": 80.0, "photoreceptor": "v2e", "threshold_mismatch": 0.03},
        {"cutoff_hz": math.inf, "hot_pixel_fraction": 0.1, "hot_pixel_hz": 900.0},
    ]
    models = [model(s, dark_level=1e-3, cutoff_reference=1.0 if k == 3 else None, **kind)
              for s in (48, 13) for k, kind in enumerate(electronics)]  # fmt: skip
    for most in (24, 5):
        monkeypatch.setattr(devices, "_CHUNK_FRAMES", most)
        starts = rng.integers(0, len(t_s), len(models)).tolist()
        starts[0], starts[1] = len(t_s) - 1, len(t_s) - 2
        speeds = rng.choice([1.0, 4 / 3, 2.0], len(models)).tolist()
        alone = [
            simulate(frames[start:], t_s[start:] / speed, m, seed=3)
            for m, start, speed in zip(models, starts, speeds, strict=True)
        ]
        assert sum(map(len, alone)) > 10_000
        for source in (frames, iter(frames)):
            together = simulate_bank(source, t_s, models, speeds=speeds, starts=starts, seed=3)
            for one, other in zip(together, alone, strict=True):
                assert_same(one, other)


@pytest.mark.parametrize("starts", [[0], [0, 25], [-1, 0], [0.5, 0], 3])
def test_starts_are_indices_of_frames(scene, starts):
    """Promise: the error names the argument and the range."""
    frames, t_s = scene
    with pytest.raises(SensorError, match=r"starts: found .*2 indices .*0\.\.24"):
        simulate_bank(frames, t_s, [model(13), model(48)], starts=starts)


def test_ideal_events_do_not_depend_on_speed(scene):
    """Physics: an ideal pixel sees the same levels in the same order at any speed (claim 5)."""
    frames, t_s = scene
    ideal = model(cutoff_hz=math.inf)
    slow, fast = simulate_bank(frames, t_s, [ideal, ideal], speeds=[1.0, 2.0])
    np.testing.assert_array_equal(slow.polarity_sum(), fast.polarity_sum())
    assert len(slow) == len(fast)
    assert abs(int(slow.t_us[-1]) - 2 * int(fast.t_us[-1])) <= 2


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("size", [1, 2, 50, 1001, 20_000, 400_000])
def test_white_level_is_the_percentile(kind, size):
    """Promise: NumPy's percentile but for the last bits, which its versions round differently."""
    rng = np.random.default_rng(size)
    many = rng.lognormal(0, 2, size).astype(kind)
    for values in (many, np.sort(many), np.sort(many)[::-1], np.round(many), np.ones(size, kind)):
        expected = float(np.percentile(values, 99.9))
        last_bits = 3e-7 if kind is np.float32 else 1e-12
        assert white_level(values) == pytest.approx(expected, rel=last_bits)


def test_dark_level_defaults_to_a_thousandth_of_the_first_frames_white(scene):
    """Promise: the dark rule is explicit and stored with the events."""
    frames, t_s = scene
    events = simulate(frames, t_s, model())
    white = np.percentile(frames[0], 99.9)
    assert events.model.dark_level == pytest.approx(1e-3 * white)
    explicit = simulate(frames, t_s, model(dark_level=events.model.dark_level))
    assert_same(events, explicit)


def test_one_step_from_black_fires_as_the_dark_level_says():
    """Physics: 0 -> 0.5 crosses floor(log((0.5 + d) / d) / C) levels, the same for any start."""
    frames = np.array([0.0, 0.5], np.float32)[:, None, None]
    tiny = SensorModel(width=1, height=1, dark_level=0.01)
    assert len(simulate(frames, [0.0, 1e-3], tiny)) == math.floor(math.log(51) / 0.2)


def test_random_start_is_seeded_and_spreads_first_events():
    """Promise: memories start uniformly in (-C, C); the same seed gives the same events."""
    t_s = np.array([0.0, 0.01])
    frames = np.ones((2, 100, 100))
    frames[1] *= math.exp(0.19999)  # just less than C: in step, no pixel would fire
    assert len(simulate(frames, t_s, model(100, math.inf, dark_level=0.0))) == 0
    drawn = model(100, math.inf, dark_level=0.0, random_start=True)
    a, b = (simulate(frames, t_s, drawn, seed=s, threads=s + 1) for s in (0, 1))
    assert_same(a, simulate(frames, t_s, drawn, seed=0, threads=2))
    assert len(a) != len(b) or not np.array_equal(a.x, b.x)
    assert abs(len(a) / 10_000 - 0.5) < 0.02  # memory below u(t0) by 0..C in half of the pixels
    assert np.histogram(a.t_us, 4, (0, 10_000))[0].min() > 1000


def test_events_know_windows_and_sums(scene):
    """Promise: windows are half-open, and slices keep size and model."""
    frames, t_s = scene
    events = simulate(frames, t_s, model())
    early, late = events.between(0, 12_000), events.between(12_000, 10**9)
    assert len(early) + len(late) == len(events)
    assert early.t_us[-1] < 12_000 <= late.t_us[0]
    assert early.width == 48
    assert early.model == events.model
    total = np.zeros((48, 48), np.int64)
    np.add.at(total, (events.y, events.x), events.p)
    np.testing.assert_array_equal(events.polarity_sum(), total)


BAD_FRAMES = {
    "nan": (lambda f, t: (np.where(f == f[3, 5, 6], np.nan, f), t), "frame 3, pixel x=6 y=5"),
    "negative": (lambda f, t: (np.where(f == f[0, 1, 2], -1, f), t), "frame 0, pixel x=2 y=1"),
    "infinite": (lambda f, t: (np.where(f == f[9, 1, 2], np.inf, f), t), "frame 9, pixel x=2 y=1"),
    "uint8": (lambda f, t: ((f * 9).astype(np.uint8), t), "uint8"),
    "too few times": (lambda f, t: (f, t[:-1]), "expected (24, H, W)"),
    "ends early": (lambda f, t: (iter(f[:20]), t), "ended after 20 frames, expected 25"),
    "too many frames": (lambda f, t: (iter(f), t[:20]), "more than 20"),
    "changes size": (lambda f, t: ([*f[:4], f[4, 1:], *f[5:]], t), "frame 4: found shape (47, 48)"),
    "times repeat": (lambda f, t: (f, np.where(t == t[7], t[6], t)), "t_s[7]"),
    "times unsorted": (lambda f, t: (f, t[::-1]), "t_s[1]"),
    "time nan": (lambda f, t: (f, np.where(t == t[2], np.nan, t)), "t_s[2]"),
    "no frames": (lambda f, t: (iter([]), t), "ended after 0 frames, expected 25"),
    "one frame alone": (lambda f, t: (f[0], t), "expected (25, H, W)"),
}


@pytest.mark.parametrize(("size", "cutoff_hz"), [(48, math.inf), (48, 200.0), (13, math.inf)])
@pytest.mark.parametrize("case", BAD_FRAMES)
def test_bad_frames_are_named(scene, case, size, cutoff_hz):
    """Promise: invalid input gives one clear error with its place, never a result."""
    spoil, text = BAD_FRAMES[case]
    frames, t_s = spoil(*scene)
    with pytest.raises(SensorError) as error:
        simulate(frames, t_s, model(size, cutoff_hz))
    assert text in str(error.value)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_faintest_negative_light_is_refused(dtype):
    """Promise: negative light is an error also for an ideal pixel, which needs no logarithm of
    light that fires no events."""
    frames = np.ones((4, 3, 3), dtype)
    frames[2, 1, 0] = -np.finfo(dtype).smallest_subnormal
    with pytest.raises(SensorError, match="frame 2, pixel x=0 y=1"):
        simulate(frames, np.arange(4.0), model(3, math.inf, dark_level=2.0))


@pytest.mark.parametrize("dtype", [">f8", np.longdouble])
def test_frames_of_any_wide_float_keep_the_precision_of_double(dtype):
    """Promise: floats of the other byte order, as in FITS files, and wider ones lose no event to
    single precision, in an array or one after the other."""
    frames = (1 + 1e-9 * np.arange(30.0))[:, None, None] * np.ones((1, 2, 2))
    t_s, fine = np.arange(30.0), model(2, math.inf, dark_level=0.0, contrast_threshold=1.5e-9)
    expected = simulate(frames, t_s, fine)
    assert len(expected) == 19 * 4
    assert_same(simulate(frames.astype(dtype), t_s, fine), expected)
    assert_same(simulate(iter(frames.astype(dtype)), t_s, fine), expected)


@pytest.mark.parametrize(("dtype", "decades"), [(np.float32, 37), (np.float64, 300)])
@pytest.mark.parametrize("leak_hz", [0.0, 0.1])
def test_ideal_pixels_fire_in_the_faintest_and_in_the_brightest_light(dtype, decades, leak_hz):
    """Physics: |change of log intensity| / C events, for any light that a float can store."""
    rng = np.random.default_rng(0)
    scale = 10.0 ** rng.uniform(-decades, decades, (1, 40, 40))
    steps = np.exp(np.cumsum(rng.normal(0, 0.15, (30, 40, 40)), axis=0))
    frames = (scale * steps).astype(dtype)
    C = 0.2
    events = simulate(frames, np.arange(30.0), model(40, math.inf, dark_level=0.0, leak_hz=leak_hz))
    level = np.log(frames[0].astype(np.float64))
    count = np.zeros((40, 40), int)
    for k, frame in enumerate(frames[1:], 1):
        gone = np.log(frame.astype(np.float64)) + C * leak_hz * k - level
        fired = np.trunc(gone / C)
        count += np.abs(fired).astype(int)
        level += C * fired
    ours = np.zeros((40, 40), int)
    np.add.at(ours, (events.y, events.x), 1)
    np.testing.assert_array_equal(ours, count)
    assert count.sum() > 5000


@pytest.mark.parametrize(
    ("kwargs", "text"),
    [
        ({"width": 0}, "width"),
        ({"width": 12.0}, "width"),
        ({"height": 70_000}, "height"),
        ({"contrast_threshold": 0.0}, "contrast_threshold"),
        ({"contrast_threshold": 1e-16}, "contrast_threshold.*from 1e-09 to 1e"),
        ({"contrast_threshold": math.nan}, "contrast_threshold"),
        ({"cutoff_hz": -1.0}, "cutoff_hz"),
        ({"cutoff_hz": math.nan}, "cutoff_hz"),
        ({"dark_level": -1e-3}, "dark_level"),
    ],
)
def test_bad_models_are_refused(kwargs, text):
    """Promise: the constructor refuses an impossible model."""
    with pytest.raises(SensorError, match=text):
        SensorModel(**{"width": 4, "height": 4, **kwargs})


@pytest.mark.parametrize("radiance", [1e305, 1e-298])
def test_light_that_gives_no_dark_level_is_named(radiance):
    frames = np.full((2, 2, 2), radiance)
    with pytest.raises(SensorError, match=r"dark_level: .* a white level of 1e"):
        simulate(frames, [0.0, 1.0], SensorModel(width=2, height=2))


def test_levels_that_leaked_below_single_precision_are_not_taken_for_silent(monkeypatch):
    """Promise: float32 frames give the events of float64 frames, in chunks of any length, where the
    memory falls by 100 log units within a chunk, too."""
    electronics = {"contrast_threshold": 5.0, "leak_hz": 4.1857142857 / 5, "random_start": True}
    model = SensorModel(width=60, height=60, dark_level=1e-6, **electronics)
    frames, t_s = np.full((29, 60, 60), 1e-6, np.float32), np.arange(29.0)
    single, double = simulate(frames, t_s, model), simulate(frames.astype(np.float64), t_s, model)
    monkeypatch.setattr(devices, "_CHUNK_FRAMES", 8)
    in_parts = simulate(frames, t_s, model)
    for one in (double, in_parts):
        assert_same(single, one)


def test_sensor_finer_than_frames_and_black_scenes_are_refused(scene):
    """Promise: no upsampling of light, no logarithm of 0."""
    frames, t_s = scene
    with pytest.raises(SensorError, match="finer than the frames of 48x48"):
        simulate(frames, t_s, model(49))
    with pytest.raises(SensorError, match=r"dark_level: .* is black"):
        simulate(np.zeros_like(frames), t_s, model())
    with pytest.raises(SensorError, match="dark_level is 0"):
        simulate(np.zeros_like(frames), t_s, model(dark_level=0.0))
    with pytest.raises(SensorError, match="speeds"):
        simulate_bank(frames, t_s, [model()], speeds=[0.0])
    with pytest.raises(SensorError, match=r"models: found \[\]"):
        simulate_bank(frames, t_s, [])


@pytest.mark.parametrize(("value", "said"), [(np.nan, "radiance nan"), (-1.0, "radiance -1")])
def test_bad_radiance_is_named_without_a_dark_level(scene, value, said):
    """Promise: frame and pixel, also where the sensor has the frames' size and no dark level."""
    frames, t_s = scene
    frames = frames.copy()
    frames[3, 2, 1] = value
    with pytest.raises(SensorError, match=f"frame 3, pixel x=1 y=2: found {said}"):
        simulate(frames, t_s, model(48, dark_level=0.0))


def test_events_refuse_what_is_not_an_event_stream():
    """Promise: the constructor of `Events` checks dtype, shape, range and order."""
    t = np.array([1, 2, 3])
    x = np.array([0, 1, 2], np.uint16)
    p = np.array([1, -1, 1], np.int8)
    Events(t, x, x, p, 3, 3)
    for spoiled, text in [
        ((t[::-1].copy(), x, x, p, 3, 3), "earlier"),
        ((t.astype(float), x, x, p, 3, 3), "t_us"),
        ((t, x, x, p, 2, 3), "Events.x: found 2"),
        ((t, x, x[:2], p, 3, 3), r"Events.y: found uint16 of shape \(2,\)"),
        ((t, x, x, p * 0, 3, 3), "Events.p"),
    ]:
        with pytest.raises(EventError, match=text):
            Events(*spoiled)
    with pytest.raises(TypeError):
        Events(t, x, x, p, 3, 3)[::2]
