"""`eres fit` gets back the parameters of simulated sensors, inside its own intervals."""

import functools

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moving_texture import texture_in_motion
from sensor import Events, SensorModel, simulate
from sensor.engine.bank import white_level
from sensor.formats import write_events
from sensor.profiles import read_profile
from tasks.errors import TaskError
from tasks.fitting.estimate import poisson_rate, share
from tasks.fitting.fit import Evidence, Found
from tasks.fitting.fit import fit as fit_recording
from tasks.fitting.profile_file import write_profile
from tasks.fitting.response import fit_response
from tasks.fitting.steps import read_steps
from tasks.fitting.stillness import fit_noise
from tasks.fitting.thresholds import changes_between, counts, fit_thresholds

HEIGHT, WIDTH = 60, 80


def inside(estimate, truth):
    assert estimate.low <= truth <= estimate.high, f"{estimate} misses {truth}"


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


def test_a_fitted_profile_has_the_noise_of_the_recording(tmp_path):
    """Promise: a sensor with the profile fires as much noise in the same light."""
    events, seconds = still(shot_noise_hz=4.0)  # 2 Hz in this light
    found = fit_recording(events, Evidence(still_s=(0.0, seconds - 0.01)))
    write_profile(tmp_path / "p.toml", "x", found.fields("rec.h5"))
    plain = SensorModel(width=WIDTH, height=HEIGHT, dark_level=1.0)
    model = read_profile(tmp_path / "p.toml").applied_to(plain)
    again = simulate(np.full((2, HEIGHT, WIDTH), 3.0), [0.0, seconds], model, seed=9)
    assert len(again) == pytest.approx(len(events), rel=0.02)


def test_intervals_of_counts_are_the_textbooks():
    """Source: Garwood 1936, 0 events: 0 to 3.69; 10: 4.80 to 18.39. Clopper and Pearson 1934, 0 of
    10: 0 to 0.308."""
    assert poisson_rate(0, 1.0) == pytest.approx((0, 0, 3.689), abs=1e-3)
    assert poisson_rate(10, 1.0) == pytest.approx((10, 4.795, 18.39), abs=1e-2)
    assert share(0, 10) == pytest.approx((0, 0, 0.3085), abs=1e-4)


@functools.cache
def texture():
    light, t_s = texture_in_motion(3, 200, (HEIGHT, WIDTH), 2e-3, travel_px=70.0)
    return light / light.max(), t_s


def moving(C_on, C_off, dark, **electronics):
    """Return frames, one in ten of those that the sensor saw, with times; and the events."""
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
    events = simulate(light, t_s, model, seed=1)
    every = slice(10, None, 10)
    return light[every], np.round(1e6 * t_s[every]).astype(np.int64), events


@pytest.mark.parametrize("dark", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize(("C_on", "C_off"), [(0.2, 0.2), (0.15, 0.25), (0.35, 0.28)])
def test_frames_give_back_the_thresholds(C_on, C_off, dark):
    """Promise: both thresholds lie in their intervals, at the dark level of the sensor."""
    frames, t_us, events = moving(C_on, C_off, dark, threshold_mismatch=0.01)
    found = fit_thresholds(changes_between(frames, t_us, events, 1.0), dark)
    inside(found.on, C_on)
    inside(found.off, C_off)
    assert found.on.high - found.on.low < 0.16 * C_on


def test_a_wrong_dark_level_gives_other_thresholds():
    """Promise: the sweep shows what the dark level decides: more of it, smaller changes."""
    frames, t_us, events = moving(0.2, 0.2, 1e-2)
    changes = changes_between(frames, t_us, events, 1.0)
    values = [fit_thresholds(changes, dark).on.value for dark in (1e-2, 1e-1, 3e-1)]
    assert values == sorted(values, reverse=True)
    assert values[-1] < 0.75 * values[0]


def test_noise_and_hot_pixels_change_little():
    """Promise: outliers bias the thresholds by a few percent at most."""
    noisy = {"hot_pixel_fraction": 0.01, "hot_pixel_hz": 300.0, "shot_noise_hz": 1.0}
    frames, t_us, events = moving(0.2, 0.2, 1e-2, **noisy)
    found = fit_thresholds(changes_between(frames, t_us, events, 1.0), 1e-2)
    assert found.on.value == pytest.approx(0.2, rel=0.05)
    assert found.off.value == pytest.approx(0.2, rel=0.05)


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


def test_the_command_writes_a_profile_that_simulates(eres, tmp_path):
    """Promise: RECORDING in, a profile with intervals and sources out, and a sentence about the
    dark level."""
    frames, t_us, events = moving(0.2, 0.25, 1e-2)
    write_events(tmp_path / "recording.h5", events)
    folder = tmp_path / "frames"
    folder.mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(f"{folder}/{k:04d}.tiff", frame)
    (folder / "timestamps.txt").write_text("\n".join(["# unit: us", *map(str, t_us)]))
    out = tmp_path / "mine.toml"
    code, printed, err = eres(
        *("fit", tmp_path / "recording.h5", "--out", out, "--frames", folder),
        *("--dark", 1e-2 / white_level(frames[0])),
        *("--still", "0", "0.1", "--title", "My camera"),
    )
    assert (code, err) == (0, "")
    assert "the answer depends on the dark level: from 0.03 to 10 % of white, ON is" in printed
    profile = read_profile(out)
    assert profile.title == "My camera"
    low, high = profile.known["threshold_off"].interval
    assert low < 0.25 < high
    assert "recording.h5: frames, with a dark level of " in profile.known["threshold_on"].source
    model = profile.applied_to(SensorModel(width=4, height=4))
    assert model.off_threshold > model.contrast_threshold
    code, _, err = eres("fit", tmp_path / "recording.h5", "--out", out, "--still", "0", "0.1")
    assert (code, "exists already" in err) == (1, True)


def test_a_profile_of_everything_can_be_read_again(tmp_path):
    events, rises_us = flashes(200.0, 2e-4)
    found = fit_recording(events, Evidence(rises_us=rises_us, still_s=(0.0, 0.001)))
    write_profile(tmp_path / "p.toml", 'a "b"\\', found.fields("rec.h5"))
    profile = read_profile(tmp_path / "p.toml")
    assert profile.title == 'a "b"\\'
    assert profile.known["photoreceptor"].value == "two_pole"
    assert profile.known["shot_noise_exponent"].interval is None
    assert profile.known["cutoff"].interval[0] < 200 < profile.known["cutoff"].interval[1]


EMPTY = Events(*(np.empty(0, t) for t in ("i8", "u2", "u2", "i1")), width=4, height=4)


@pytest.mark.parametrize(
    ("evidence", "text"),
    [
        ({}, "found neither still, frames nor steps"),
        ({"still_s": (1.0, 0.5)}, "still: found 1 to 0.5 s, expected a start"),
        ({"still_s": (-1.0, 0.5)}, "still: found -1 to 0.5 s"),
        ({"still_s": (0.0, 1.0), "dark_share": 0.0}, "dark: found 0, expected a share"),
        ({"still_s": (0.0, 1.0)}, "without events"),
    ],
)
def test_impossible_evidence_is_refused(evidence, text):
    with pytest.raises(TaskError, match=text):
        fit_recording(EMPTY, Evidence(**evidence))


def test_recordings_that_do_not_show_enough_are_refused(tmp_path):
    frames, t_us, events = moving(0.2, 0.2, 1e-2)
    with pytest.raises(TaskError, match="still: found an end of 9 s, expected at most 0"):
        fit_recording(events, Evidence(still_s=(0.0, 9.0)))
    with pytest.raises(TaskError, match="frame 0: found 40x60 px, expected 80x60, the size"):
        changes_between(frames[:, :, ::2], t_us, events, 1.0)
    with pytest.raises(TaskError, match="found 0 changes between events near frames"):
        changes_between(frames, t_us + 10**9, events, 1.0)
    with pytest.raises(TaskError, match="ON events of a pixel after a step, expected at least 3"):
        fit_response(events, np.array([0, 1000]))
    with pytest.raises(TaskError, match="steps: found 1 times, expected at least 2"):
        fit_response(events, np.array([0]))
    file = tmp_path / "steps.txt"
    file.write_text("100\n\n2e3 # ON\n")
    assert read_steps(str(file), file).tolist() == [100, 2000]
    file.write_text("100\nsoon")
    with pytest.raises(TaskError, match=r"steps.txt:2: found 'soon', expected a time in us"):
        read_steps(str(file), file)
    with pytest.raises(TaskError, match=r"none\.txt: no such file"):
        read_steps(str(tmp_path / "none.txt"), file)


@given(st.integers(0, 2000), st.integers(1, 50))
def test_a_longer_stretch_narrows_the_interval(count, times):
    """Promise: the interval holds the estimate, and shrinks with the number of events."""
    once, often = poisson_rate(count, 1.0), poisson_rate(count * times, float(times))
    assert once.low <= once.value <= once.high
    assert often.high - often.low <= once.high - once.low + 1e-9


def test_nothing_asked_nothing_found():
    assert Found().fields("x") == {}
