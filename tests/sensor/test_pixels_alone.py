"""The pixels of a GPU, one by one, fire as those of `advance`, block by block."""

import math

import numpy as np
import pytest

from another_process import run_python
from drawn_sensors import PIXELS, drawn, is_too_near, row_of
from exact_sensor import exact_events
from pixel_loop import events_of_row
from sensor import SensorModel, simulate

pytestmark = pytest.mark.slow


def by_pixel(t_us, x, p):
    """Return [(times, polarities) of each pixel]."""
    return [(t_us[x == k], p[x == k].tolist()) for k in range(PIXELS)]


def check(radiance, t_s, model, seed=0, exact=None):
    """Compare both; return the number of pixels that differ, near a level only."""
    events = simulate(radiance[:, None, :], t_s, model, seed=seed, threads=1)
    blocks = by_pixel(events.t_us, events.x, events.p)
    alone = by_pixel(*events_of_row(radiance, t_s, model, seed))
    unlike = 0
    for x, ((t_us, p), (other_us, q)) in enumerate(zip(blocks, alone, strict=True)):
        if p != q or np.abs(t_us - other_us).max(initial=0) > 1:
            assert exact is not None, (x, t_us, other_us)
            assert is_too_near(exact_events(radiance[:, x], t_s, exact))
            unlike += 1
    return unlike, len(events)


def test_drawn_pixels_agree():
    """Promise: count, polarity and order are those of the CPU, times within 1 us, for any frame
    interval, cutoff, leak and clock."""
    unlike = fired = 0
    for seed in range(300):
        _, radiance, t_s, pixel = drawn(seed)
        model = row_of(pixel)
        found = check(radiance, t_s, model, exact=pixel)
        unlike, fired = unlike + found[0], fired + found[1]
    assert unlike < 0.01 * 300 * PIXELS
    assert fired > 300 * PIXELS


@pytest.mark.parametrize("cutoff_hz", [math.inf, 50.0])
def test_patterns_and_noise_agree(cutoff_hz):
    """Promise: the same for mismatch, hot pixels and shot noise, which share the random numbers."""
    rng = np.random.default_rng(1)
    radiance = np.exp(np.cumsum(rng.normal(0, 0.1, (30, PIXELS)), axis=0))
    model = SensorModel(
        width=PIXELS,
        height=1,
        cutoff_hz=cutoff_hz,
        dark_level=0.1,
        leak_hz=20.0,
        threshold_mismatch=0.04,
        random_start=True,
        shot_noise_hz=300.0,
        hot_pixel_fraction=0.2,
        hot_pixel_hz=2e4,
    )
    unlike, fired = check(radiance, np.arange(30) * 2e-3, model, seed=4)
    assert unlike == 0
    assert fired > 3000


SIMULATED = """
import math, sys
import numpy as np
import sensor.gpu.kernels as kernels
from numba import cuda
from sensor import LiveCamera, SensorError, SensorModel, simulate
from sensor.events import concatenate
from sensor.gpu.group import _sorted
from sensor.gpu.memory import Scratch

def plain(value):  # compiled functions do not take the simulator's arrays
    while hasattr(value, "_ary") or "_item" in getattr(value, "__dict__", ()):
        value = value.__dict__.get("_ary", value.__dict__.get("_item"))
    return type(value)(*map(plain, value)) if isinstance(value, tuple) else value

def called(function):
    return lambda *arguments: function(*map(plain, arguments))

for name in ("advance_filtered", "fire_line", "fire_noise"):
    setattr(kernels, name, called(getattr(kernels, name)))
rng = np.random.default_rng(0)
if sys.argv[1] == "sort":
    for size, span_us in ((1, 5), (4097, 300)):
        words = rng.integers(0, span_us + 1, size).astype(np.uint64) << np.uint64(33)
        words |= rng.integers(0, 1 << 33, size).astype(np.uint64)
        there = cuda.to_device(words), cuda.device_array(size, np.uint64)
        found = _sorted(*there, span_us, Scratch("test")).copy_to_host()
        expected = words[np.argsort(words >> np.uint64(33), kind="stable")]
        np.testing.assert_array_equal(found, expected)
    values = rng.integers(0, 9, (5, 1000))
    there, starts = cuda.to_device(values), cuda.device_array(6, np.int64)
    kernels.launch(kernels.sums_before, 1, there, starts, threads=kernels.SCAN_THREADS)
    sums = np.concatenate(([0], np.cumsum(values)))
    np.testing.assert_array_equal(there.copy_to_host().ravel(), sums[:-1])
    np.testing.assert_array_equal(starts.copy_to_host(), sums[::1000])
else:
    width, height, cutoff_hz = int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    frames = np.exp(np.cumsum(rng.normal(0, 0.3, (4, 15, 20)), axis=0))
    model = SensorModel(
        width=width, height=height, cutoff_hz=cutoff_hz, leak_hz=20.0, dark_level=0.1,
        shot_noise_hz=100.0 * (width == 20),
    )
    t_s = np.arange(4) * 5e-4
    cpu, gpu = (simulate(frames, t_s, model, device=device) for device in ("cpu", "cuda"))
    assert len(cpu) > 10
    np.testing.assert_array_equal(cpu.x, gpu.x)
    np.testing.assert_array_equal(cpu.y, gpu.y)
    np.testing.assert_array_equal(cpu.p, gpu.p)
    assert np.abs(cpu.t_us - gpu.t_us).max() <= 1
    with LiveCamera(model, device="cuda") as live:
        there = cuda.to_device(frames[2:])
        parts = live.push(frames[:2], t_s[:2]), live.push(there, t_s[2:]), live.finish()
    for one, other in zip(concatenate(parts).columns, gpu.columns, strict=True):
        np.testing.assert_array_equal(one, other)
    frames[2, 4, 7] = {20: math.nan, 10: -1e-3}[width]
    try:
        simulate(frames, t_s, model, device="cuda")
        raise AssertionError("invalid radiance is not refused")
    except SensorError as error:
        assert str(error).startswith("frame 2, pixel x=7 y=4: found radiance"), error
"""


@pytest.mark.parametrize("what", [("sort",), (20, 15, math.inf), (10, 7, 2000.0)])
def test_kernels_are_right_in_a_simulated_gpu(what):
    """Promise: without a GPU, Numba's simulator of one runs the same kernels, with the events of
    the CPU; `-m gpu` tests them on a real one."""
    run_python(SIMULATED, *what, timeout_s=300, NUMBA_ENABLE_CUDASIM="1")
