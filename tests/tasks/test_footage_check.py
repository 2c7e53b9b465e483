"""Estimates on a clip whose true events are known: lost between frames, and noise of the frames."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from in_memory import footage_of
from sensor import SensorModel, simulate, to_linear
from sensor.encoding import to_srgb
from tasks.events.footage_check import FootageCheck

HEIGHT, WIDTH = 96, 144
MODEL = SensorModel(width=WIDTH, height=HEIGHT, dark_level=1e-3)


@functools.cache
def texture(fineness_px):
    """Return the spectrum of each row."""
    rng = np.random.default_rng(0)
    smooth = gaussian_filter(rng.normal(size=(HEIGHT, 256)), fineness_px, mode="wrap")
    return np.fft.rfft(np.clip(0.5 + 0.16 * smooth / smooth.std(), 0.03, 1))


def panned(spectrum, shift_px):
    moved = spectrum * np.exp(2j * np.pi / 256 * np.arange(129) * shift_px)
    return np.maximum(np.fft.irfft(moved)[:, :WIDTH], 0.02).astype(np.float32)


def checked(frames, model=MODEL, *, speed=1.0, with_between=False):
    """Return the check after a simulation of frames 10 ms apart, and the number of events."""
    footage = footage_of(frames, 1e-2)
    everything = slice(None), slice(None)
    check = FootageCheck(footage, everything, model, speed, with_between=with_between)
    events = simulate(iter(check.watched()), footage.t_s / speed, model)
    check.count(events)
    return check, len(events)


def filmed(frames, deviation, seed=1):
    """Return frames with the noise of a camera, in 8 bits."""
    rng = np.random.default_rng(seed)
    noisy = [one + deviation * rng.normal(size=one.shape) * np.sqrt(1 + one) for one in frames]
    codes = (255 * to_srgb(np.clip(noisy, 0, 1))).round().astype(np.uint8)
    return list(to_linear(codes, "srgb"))


@pytest.mark.parametrize("speed", [1.0, 4.0])
@pytest.mark.parametrize(("fineness_px", "motion_px"), [(1, 2), (1, 6), (2, 4), (2, 10), (6, 4)])
def test_lost_events_are_estimated(fineness_px, motion_px, speed):
    """Reference: the same texture with twelve times the frames; what is lost depends on it far more
    than on the motion."""
    image = texture(fineness_px)
    model = replace(MODEL, cutoff_hz=400.0)
    every = [panned(image, motion_px * k / 12) for k in range(12 * 12 + 1)]
    check, count = checked(every[::12], model, speed=speed)
    t_s = 1e-2 / 12 * np.arange(len(every)) / speed
    assert check.lost == pytest.approx(1 - count / len(simulate(every, t_s, model)), abs=0.1)
    assert check.noise < 0.02


@pytest.mark.parametrize("deviation", [0.01, 0.03])
@pytest.mark.parametrize("moving", [0, 36, WIDTH])
def test_noise_of_frames_is_found_where_nothing_moves(deviation, moving):
    """Reference: the events of the same frames without noise, still, and in motion in a part or in
    all of the picture. The estimate is a lower bound, near the truth if most is still."""
    image = texture(2)
    frames = [panned(image, 0) for _ in range(16)]
    for k, frame in enumerate(frames):
        frame[:, WIDTH - moving :] = panned(image, 3 * k)[:, WIDTH - moving :]
    count = checked(frames)[1]
    check, with_noise = checked(filmed(frames, deviation), with_between=moving == 36)
    true = 1 - count / with_noise
    assert check.noise < true + 0.03
    if moving < WIDTH:
        assert check.noise > 0.75 * true - 0.02


@pytest.mark.parametrize("fineness_px", [0.7, 1, 3])
@pytest.mark.parametrize("motion_px", [0.3, 1, 4.4])
def test_motion_and_changes_of_the_light_are_no_noise(fineness_px, motion_px):
    """Promise: no share is called noise in frames without any, fine textures and lamps included."""
    image = texture(fineness_px)
    moving = [panned(image, motion_px * k) for k in range(12)]
    assert checked(moving)[0].noise < 0.03
    lamp = [panned(image, 0) * np.float32(1 + 0.3 * np.sin(2.5 * k)) for k in range(12)]
    assert checked(lamp)[0].noise < 0.03


def test_noise_of_the_camera_is_not_that_of_the_frames():
    """Promise: what the sensor adds by itself, which its user asked for, is left out."""
    model = replace(MODEL, shot_noise_hz=200.0, hot_pixel_fraction=0.01, hot_pixel_hz=1000.0)
    check, count = checked(filmed([panned(texture(2), 0)] * 12, 0.006), model)
    assert count > 1000
    assert check.noise < 0.03


@pytest.mark.parametrize("count", [2, 3, 5, 6])
@pytest.mark.parametrize("size", [(1, 1), (7, 30), (33, 9)])
def test_short_clips_and_small_sensors_are_checked(count, size):
    """Promise: shares are between 0 and 1, whatever there is to look at."""
    rng = np.random.default_rng(0)
    frames = [rng.random(size, np.float32) for _ in range(count)]
    check, _ = checked(frames, replace(MODEL, width=size[1], height=size[0], dark_level=None))
    assert 0 <= check.lost <= 1
    assert 0 <= check.noise <= 1
