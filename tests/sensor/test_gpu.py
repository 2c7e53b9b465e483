"""On a machine with an NVIDIA GPU, `device="cuda"` gives the events of the CPU."""

import math

import numpy as np
import pytest

from drawn_sensors import PIXELS, drawn, is_too_near, row_of
from exact_sensor import exact_events
from moving_texture import texture_in_motion
from sensor import (
    LiveCamera,
    SensorError,
    SensorModel,
    release_memory,
    simulate,
    simulate_bank,
    stream,
)
from sensor.events import concatenate

pytestmark = pytest.mark.gpu

KINDS = {
    "ideal": {},
    "thresholds apart": {"contrast_threshold": 0.15, "contrast_threshold_off": 0.3},
    "mismatch": {"threshold_mismatch": 0.04, "random_start": True},
    "leak": {"leak_hz": 30.0},
    "200 Hz": {"cutoff_hz": 200.0},
    "5 Hz": {"cutoff_hz": 5.0, "threshold_mismatch": 0.02},
    "one pole": {"cutoff_hz": 50.0, "photoreceptor": "one_pole", "leak_hz": 20.0},
    "v2e": {"cutoff_hz": 100.0, "photoreceptor": "v2e"},
    "own light": {"cutoff_hz": 100.0, "cutoff_reference": 2.0},
    "shot noise": {"shot_noise_hz": 200.0, "cutoff_hz": 200.0},
    "hot pixels": {"hot_pixel_fraction": 0.1, "hot_pixel_hz": 3000.0},
    "refractory": {"refractory_s": 1e-3, "latency_s": 2e-4},
}


def check(cpu, gpu):
    """Check that two streams are equal but for a microsecond."""
    assert len(cpu) == len(gpu)
    assert np.abs(cpu.t_us - gpu.t_us).max(initial=0) <= 1
    order = [np.lexsort((np.arange(len(one)), one.x, one.y)) for one in (cpu, gpu)]
    for name in ("x", "y", "p"):
        pair = [getattr(one, name)[by] for one, by in zip((cpu, gpu), order, strict=True)]
        np.testing.assert_array_equal(*pair)
    assert np.all(np.diff(gpu.t_us) >= 0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("interval_s", [1e-5, 1e-3, 5e-3, 0.5])
def test_events_are_those_of_the_cpu(kind, interval_s):
    """Promise: same pixels and polarities, in the same order in each pixel, times within 1 us."""
    frames, t_s = texture_in_motion(3, 40, (90, 120), interval_s)
    for width, height in ((120, 90), (53, 40)):
        model = SensorModel(width=width, height=height, **KINDS[kind])
        cpu = simulate(frames, t_s, model, seed=5)
        check(cpu, simulate(frames, t_s, model, seed=5, device="cuda"))
    assert len(cpu) > 100 or interval_s < 1e-4  # too short for a filter


@pytest.mark.parametrize("part", range(10))
def test_drawn_sensors_agree(part):
    """Promise: the same for any interval, cutoff, leak and clock, except for voltages that come
    within rounding of a level without crossing it."""
    unlike = 0
    for seed in range(10 * part, 10 * part + 10):
        _, radiance, t_s, pixel = drawn(seed)
        model = row_of(pixel)
        frames = radiance[:, None, :]
        cpu, gpu = simulate(frames, t_s, model), simulate(frames, t_s, model, device="cuda")
        for x in range(PIXELS):
            one, other = (events.where(events.x == x) for events in (cpu, gpu))
            alike = one.p.tolist() == other.p.tolist()
            if not alike or np.abs(one.t_us - other.t_us).max(initial=0) > 1:
                exact = exact_events(radiance[:, x], t_s, pixel)
                assert is_too_near(exact), (seed, x, one, other)
                unlike += 1
    assert unlike < 0.01 * 10 * PIXELS


def test_large_sensors_and_many_events_agree():
    """Promise: the same over many blocks of threads, tiles of the sort, and parts of a stream."""
    frames, t_s = texture_in_motion(4, 30, (720, 1280), 2e-3, travel_px=200.0)
    for kind in ({}, {"cutoff_hz": 200.0}):
        model = SensorModel(width=1280, height=720, contrast_threshold=0.1, **kind)
        parts = list(stream(frames, t_s, model, device="cuda"))
        assert len(parts) > 1
        cpu, gpu = simulate(frames, t_s, model), concatenate(parts)
        assert len(cpu) > 1e7
        check(cpu, gpu)
        # (y, x) of one microsecond in order
        place = gpu.y.astype(np.int64) * 1280 + gpu.x
        assert not np.any((np.diff(gpu.t_us) == 0) & (np.diff(place) < 0))


def test_banks_and_frames_one_by_one_agree():
    """Promise: several sensors and speeds at once, and frames from a generator or the GPU."""
    cuda = pytest.importorskip("numba.cuda")
    frames, t_s = texture_in_motion(5, 60, (96, 96), 1e-3)
    models = [
        SensorModel(width=w, height=w, cutoff_hz=hz) for w in (96, 40) for hz in (math.inf, 50)
    ]
    speeds = [1.0, 2.0, 1.0, 0.5]
    cpu = simulate_bank(frames, t_s, models, speeds=speeds)
    there = cuda.to_device(frames)
    for again in (
        lambda: frames,
        lambda: iter(frames),
        lambda: there,
        lambda: (there[k] for k in range(len(frames))),
        lambda: frames.astype(np.float64),
    ):
        gpu = simulate_bank(again(), t_s, models, speeds=speeds, device="cuda")
        for one, other in zip(cpu, gpu, strict=True):
            check(one, other)


@pytest.mark.parametrize("kind", KINDS)
def test_pushed_frames_agree(kind):
    """Promise: a camera that gets its frames one by one, from the host or the GPU, fires the events
    of `simulate` on the GPU, to the bit."""
    cuda = pytest.importorskip("numba.cuda")
    frames, t_s = texture_in_motion(5, 40, (90, 120), 1e-3)
    model = SensorModel(width=120, height=90, **KINDS[kind])
    whole, there = simulate(frames, t_s, model, seed=5, device="cuda"), cuda.to_device(frames)
    for pushed in (frames, there):
        with LiveCamera(model, seed=5, device="cuda") as live:
            parts = [live.push(pushed[k : k + 1], t_s[k]) for k in range(len(t_s))]
            parts.append(live.finish())
        for one, other in zip(concatenate(parts).columns, whole.columns, strict=True):
            np.testing.assert_array_equal(one, other, strict=True)


def test_a_part_that_is_held_stays():
    """Promise: no part of a stream is overwritten while somebody holds it."""
    frames, t_s = texture_in_motion(6, 200, (200, 200), 1e-3, travel_px=60.0)
    model = SensorModel(width=200, height=200, contrast_threshold=0.05)
    held, sums = [], []
    for part in stream(frames, t_s, model, device="cuda"):
        held.append(part)
        sums.append((int(part.t_us.sum()), int(part.x.sum()), int(part.p.sum())))
    assert len(held) > 5
    assert sums == [(int(e.t_us.sum()), int(e.x.sum()), int(e.p.sum())) for e in held]


def test_simulations_at_once_do_not_mix():
    """Promise: streams that take turns have memory of their own; a later one uses it again."""
    frames, t_s = texture_in_motion(8, 150, (100, 100), 1e-3, travel_px=60.0)
    models = [SensorModel(width=100, height=100, cutoff_hz=hz) for hz in (math.inf, 50.0)]
    for _ in range(2):
        streams = [stream(frames, t_s, model, device="cuda") for model in models]
        counts = np.sum([[len(part) for part in parts] for parts in zip(*streams, strict=True)], 0)
        cpu = [len(simulate(frames, t_s, model)) for model in models]
        assert counts.tolist() == cpu
        release_memory()


def test_frames_on_the_gpu_that_cannot_be_are_refused():
    """Promise: the error names the frame, and what was expected."""
    cuda = pytest.importorskip("numba.cuda")
    frames, t_s = texture_in_motion(9, 6, (20, 20), 1e-3)
    model = SensorModel(width=20, height=20)
    there = cuda.to_device(frames)
    for wrong, words in (
        ((there[k : k + 1] for k in range(6)), r"frame 0: found float32 of shape \(1, 20, 20\)"),
        ((there[k] if k < 3 else frames[k] for k in range(6)), "frame 3: found type ndarray"),
        ((there[k] for k in range(5)), "frames: ended after 5"),
        (there[:, ::2], r"frame 0: found .* strides \("),
        (there[:4], r"frames: found shape \(4, 20, 20\)"),
    ):
        with pytest.raises(SensorError, match=words):
            simulate(wrong, t_s, model, device="cuda")


@pytest.mark.parametrize("bad", [-1.0, math.nan, math.inf])
def test_bad_radiance_is_refused_as_on_the_cpu(bad):
    """Promise: the error names the frame, the pixel and the value."""
    frames, t_s = texture_in_motion(7, 12, (30, 40), 1e-3)
    frames[9, 11, 13] = bad
    for width, height in ((40, 30), (20, 15)):
        model = SensorModel(width=width, height=height)
        with pytest.raises(SensorError, match=r"frame 9, pixel x=13 y=11: found radiance"):
            simulate(frames, t_s, model, device="cuda")
    frames[9, 11, 13] = 0.0
    with pytest.raises(SensorError, match="dark_level is 0"):
        simulate(frames, t_s, SensorModel(width=40, height=30, dark_level=0.0), device="cuda")
