"""The frame camera: means over the exposure, photon and read noise, sRGB."""

import json
import math

import cv2
import numpy as np
import pytest

from eres_render import render_scene
from sensor import to_linear
from tasks.errors import TaskError
from tasks.events.frame_camera import developed, exposed, frame_weights, write_images
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.recording.frames import open_frames

QUIET = FrameCameraOptions(full_well=np.inf, read_noise=0.0)


@pytest.mark.parametrize("span_s", [(0.1, 0.9), (0.12, 0.13), (0.0, 1.0), (0.3, 0.55), (0.99, 1.0)])
def test_the_mean_of_light_that_changes_evenly_is_exact(span_s):
    """A ramp's mean is its value in the middle; weights sum to 1, also within one interval."""
    t_s = np.array([0.0, 0.1, 0.15, 0.3, 0.7, 1.0])
    first, weights = frame_weights(t_s, *span_s)
    assert weights.sum() == pytest.approx(1)
    assert weights.min() >= 0
    assert weights @ t_s[first : first + len(weights)] == pytest.approx(np.mean(span_s))


def test_the_mean_of_a_kink_is_its_area():
    """A triangle from 0 up to 1 and down, by hand: the mean over its middle half is 3/4."""
    first, weights = frame_weights(np.array([0.0, 0.5, 1.0]), 0.25, 0.75)
    assert first == 0
    np.testing.assert_allclose(weights, [0.125, 0.75, 0.125])


def test_codes_are_srgb():
    """Promise: `sensor.to_linear` gives the light back; more than white is white."""
    light = np.linspace(0, 1, 400)[None]
    codes = developed(light, QUIET, np.random.default_rng(0))
    steps = to_linear(np.arange(256, dtype=np.uint8)[None], "srgb")[0]
    there = np.abs(steps[:, None] - light).argmin(axis=0)
    assert abs(codes[0].astype(int) - there).max() <= 1
    assert developed(np.array([[9.0]]), QUIET, np.random.default_rng(0)) == 255


def test_noise_is_that_of_photons_and_of_the_readout():
    """Variance in electrons: the mean's, plus the square of the read noise."""
    options = FrameCameraOptions(full_well=400.0, read_noise=12.0)
    for level in (0.3, 0.5):
        light = np.full((300, 300), level)
        codes = developed(light, options, np.random.default_rng(1))
        electrons = 400 * to_linear(codes, "srgb").astype(np.float64)
        assert electrons.mean() == pytest.approx(400 * level, rel=0.01)
        assert electrons.var() == pytest.approx(400 * level + 144, rel=0.05)


def test_the_brightest_light_in_the_largest_well_is_white():
    """Promise: any light above white is white, also where its electrons are beyond 64 bits."""
    light, options = np.array([[1e4, np.inf, 0.0]]), FrameCameraOptions(full_well=1e15)
    codes = developed(light, options, np.random.default_rng(0))
    np.testing.assert_array_equal(codes, [[255, 255, 0]])


def test_more_electrons_than_numbers_hold_are_refused():
    with pytest.raises(
        TaskError, match=r"full_well: found 1e\+19, expected a positive number of at"
    ):
        FrameCameraOptions(full_well=1e19).check()
    FrameCameraOptions(full_well=math.inf).check()


def test_numbers_of_numpy_are_numbers(small_carpet, tmp_path):
    """Promise: rates, seeds and options that were computed are stored as Python's."""
    clips = render_scene(small_carpet, tmp_path / "clips", resolution=16, spp=1, samples=1)
    stored = []
    for name, real, whole in (("plain", float, int), ("numpy", np.float64, np.int64)):
        options = FrameCameraOptions(exposure=real(0.005), full_well=whole(2000))
        write_images(clips[0], str(tmp_path / name), whole(100), options, seed=whole(3))
        stored.append((tmp_path / name / "images.json").read_text())
    assert stored[0] == stored[1]


def test_images_of_a_faster_scene_are_on_its_clock(small_carpet, tmp_path, eres):
    """Promise: at twice the speed, images are those of twice the exposure and half the rate, at
    half the times, as the times of the events are."""
    options = {"resolution": 16, "spp": 1, "max_displacement_px": 2.0, "samples": 1}
    (clip,) = render_scene(small_carpet, tmp_path / "clips", **options)
    spans_us, codes = [], []
    for rate, exposure, speed in ((100, 0.008, 1), (200, 0.004, 2)):
        out = tmp_path / f"at_{speed}"
        given = "--rate", rate, "--exposure", exposure, "--speed", speed, "--full-well", "inf"
        assert eres("images", clip.folder, "--out", out, *given)[0] == 0
        spans_us.append(np.array(json.loads((out / "images.json").read_text())["exposures_us"]))
        codes.append([cv2.imread(str(file), -1) for file in sorted(out.glob("*.png"))])
    np.testing.assert_allclose(spans_us[1], spans_us[0] / 2, atol=1)
    np.testing.assert_array_equal(codes[0], codes[1])
    given = "--out", tmp_path / "none", "--speed", 0
    code, _, error = eres("images", clip.folder, *given)
    assert (code, "speed: found 0.0, expected a positive factor" in error) == (1, True)


def test_any_sequence_has_images(small_carpet, tmp_path, eres):
    options = {"resolution": 16, "spp": 1, "max_displacement_px": 2.0, "samples": 1}
    (clip,) = render_scene(small_carpet, tmp_path / "clips", **options)
    out = tmp_path / "images"
    camera = ["--rate", 100, "--exposure", 0.004, "--full-well", "inf"]
    code, said, _ = eres("images", clip.folder, "--out", out, *camera)
    assert code == 0
    facts = json.loads((out / "images.json").read_text())
    spans_us = np.array(facts["exposures_us"])
    assert f"{out}: {len(spans_us)} images" in said
    frames = open_frames(out)  # as `eres evaluate --frames` does
    np.testing.assert_array_equal(np.stack([frames.start_us, frames.end_us], axis=1), spans_us)
    assert (
        len(list(out.glob("*.png"))) == len(spans_us) == 1 + int(100 * (np.ptp(clip.t_s) - 0.004))
    )
    assert set(np.diff(spans_us, axis=1).ravel()) == {4000}
    light = exposed(clip, clip.t_s[0] + 0.01, clip.t_s[0] + 0.014) / clip.white_level
    expected = developed(light, QUIET, np.random.default_rng(0))
    np.testing.assert_array_equal(cv2.imread(str(out / "000001.png"), -1), expected)
    for wrong, found in (
        (camera, "already; choose another folder"),
        (["--rate", 300], "expected a rate above 0 and exposures that do not overlap"),
        (["--rate", 1, "--exposure", 1], "exposure: found 1 s, expected at most 0.08"),
        (["--full-well", 0], "--full-well: found 0.0"),
        (["--read-noise", -1], "--read-noise: found -1.0"),
        (["--exposure", 0], "exposure: found 0.0"),
        (["--exposure", 1e-12], "exposure: found 1e-12, expected at least 1e-06 seconds"),
        (["--seed", -1], "seed: found -1, expected 0 or more"),
    ):
        place = out if wrong is camera else tmp_path / "none"
        code, _, error = eres("images", clip.folder, "--out", place, *wrong)
        assert code == 1
        assert found in error
    assert not (tmp_path / "none").exists()
    for name in ("frames.csv", "manifest.json"):  # of others
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text("keep")
        code, _, error = eres("images", clip.folder, "--out", tmp_path / name, *camera)
        assert (code, f"{name}: contains {name} already" in error) == (1, True)
        assert [file.name for file in (tmp_path / name).iterdir()] == [name]
    (out / "images.json").unlink()  # as after an interruption
    code, _, error = eres("images", clip.folder, "--out", out, *camera)
    assert code == 1
    assert "already; choose another folder" in error
