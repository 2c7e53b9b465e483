"""Image reconstruction: the metric, and the physical limits of event integration."""

from types import SimpleNamespace

import numpy as np
import pytest

from sensor import Events, SensorModel, simulate
from tasks.errors import TaskError
from tasks.evaluation.rendered_clip import RenderedClip
from tasks.evaluation.scorers.reconstruction import ReconstructionScorer
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import Reconstruction
from tasks.methods import load_method
from tasks.methods.event_integration import reconstruct
from tasks.psnr import MAX_PSNR_DB
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db
from tasks.registry import TASKS


def smooth_frames(size, frames):
    """Return radiance of a few drifting waves, (frames, size, size)."""
    y, x = np.mgrid[:size, :size] / size
    t = np.linspace(0, 1, frames)[:, None, None]
    waves = np.sin(6 * x + 9 * t) + np.cos(11 * y - 5 * t) + 0.5 * np.sin(17 * (x + y) + 12 * t)
    return np.exp(waves)


def test_ideal_event_integration_is_within_a_threshold_of_the_truth():
    """Physics: an ideal pixel's memory is within C of its light, and so is EI, Eq. (8)."""
    C = 0.1
    frames, t_s = smooth_frames(32, 20), np.arange(20) * 1e-3
    model = SensorModel(width=32, height=32, contrast_threshold=C, dark_level=0.01)
    events = simulate(frames, t_s, model)
    first, last = np.log(frames[0] + 0.01), np.log(frames[-1] + 0.01)
    sample = ReconstructionSample(first, events.polarity_sum().astype(float), C)
    assert np.abs(last - first).max() > 5 * C
    assert np.abs(reconstruct(sample) - last).max() < C


@pytest.mark.parametrize("upsampling", ["nearest", "bilinear", "bicubic"])
def test_upsampling_keeps_a_uniform_change(upsampling):
    """Promise: U distributes a uniform change without loss, at any ratio."""
    sample = ReconstructionSample(np.zeros((37, 37)), np.full((10, 10), 3.0), 0.2)
    np.testing.assert_allclose(reconstruct(sample, upsampling), 0.6, rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "between"),
    [
        ("_nearest", [0, 0, 1, 1]),
        ("_bilinear", [0, 0.25, 0.75, 1]),
        ("", [-0.1055, 0.2266, 0.7734, 1.1055]),
    ],
)
def test_upsampling_between_two_pixels(name, between):
    """Analytic: doubled, a step from 0 to 1 stays one, is linear between the centers, or is that of
    the cubic kernel with a = -0.75, which overshoots."""
    step = np.tile([0.0, 0.0, 1.0, 1.0], (4, 1))
    sample = ReconstructionSample(np.zeros((8, 8)), step, 1.0)
    image = load_method("reconstruction", f"event_integration{name}")(sample)
    np.testing.assert_allclose(image[3, 2:6], between, atol=1e-4)


def test_upsampling_keeps_pixel_centers_aligned():
    """Promise: a change at the center of the sensor appears at the center of the image."""
    delta = np.zeros((5, 5))
    delta[2, 2] = 1.0
    up = reconstruct(ReconstructionSample(np.zeros((20, 20)), delta, 1.0))
    y, x = np.mgrid[:20, :20] + 0.5
    assert (up * x).sum() / up.sum() == pytest.approx(10)
    assert (up * y).sum() / up.sum() == pytest.approx(10)


def test_psnr_of_known_errors():
    """Promise: peak 1 in units of white, clipped to it; equal images score 100 dB."""
    truth = np.log(np.full((10, 10), 0.5))
    assert psnr_db(truth, truth, 0.0) == MAX_PSNR_DB
    assert psnr_db(np.log(np.full((10, 10), 0.6)), truth, 0.0) == pytest.approx(20.0)
    above = np.log(np.full((10, 10), 7.0))
    assert psnr_db(above, np.log(np.full((10, 10), 3.0)), 0.0) == MAX_PSNR_DB  # both are white
    assert psnr_db(truth + 1.0, truth + 1.0 + np.log(1.2), 1.0) == pytest.approx(20.0)
    with pytest.raises(TaskError, match="shape"):
        psnr_db(truth[1:], truth, 0.0)


def test_white_is_a_high_percentile():
    """Promise: one highlight in a thousand pixels does not set the white level."""
    image = np.zeros(10_000)
    image[:5] = 50.0
    assert log_white_level(image.reshape(100, 100)) == 0.0


def test_methods_are_found_by_name():
    """Promise: every listed method loads; the error for an unknown one suggests the nearest."""
    for task, spec in TASKS.items():
        without_weights = spec.methods.keys() - {*spec.networks}
        assert all(callable(load_method(task, name)) for name in without_weights)
    with pytest.raises(TaskError, match="did you mean 'event_integration'"):
        load_method("reconstruction", "event_integratoin")
    with pytest.raises(TaskError, match="no task 'optical_flow', did you mean 'flow'"):
        load_method("optical_flow", "photometric_flow")


def reference_of(log_start, log_end):
    """Return a reference in which white is 1."""
    return SimpleNamespace(
        log_frame=lambda end, model: (log_start, log_end)[end], log_white=lambda model: 0.0
    )


@pytest.mark.parametrize(("off", "error"), [(0.4, 0.0), (None, 0.2)])
def test_event_integration_knows_the_threshold_of_off_events(off, error):
    """Analytic case: two ON events of 0.2, and one OFF event of 0.4: exact with its threshold,
    0.2 off at that pixel if the sensor has 0.2 for both."""
    model = SensorModel(width=2, height=1, contrast_threshold=0.2, contrast_threshold_off=off)
    start = np.log(np.full((1, 2), 0.5))
    end = start + np.array([[0.4, -0.4]])
    reference = reference_of(start, end)
    task = Reconstruction(methods=("event_integration",), upsampling="nearest")
    scorer = ReconstructionScorer(RenderedClip(reference, Setting(model, 1.0, 0, 100)), task)
    x = np.array([0, 1, 0], np.uint16)
    p = np.array([1, -1, 1], np.int8)
    scorer.push(Events(np.array([1, 2, 3]), x, 0 * x, p, width=2, height=1))
    (score,) = scorer.scores()
    expected_db = min(psnr_db(end + np.array([[0.0, error]]), end, 0.0), 100.0)
    assert score.value == pytest.approx(expected_db)


def test_a_camera_at_rest_has_a_score():
    """Promise: where nothing moves the images are equal, and their score is a large finite number,
    which has medians and differences."""
    log_image = np.zeros((1, 2))
    reference = reference_of(log_image, log_image)
    task = Reconstruction(methods=("event_integration", "no_events"))
    setting = Setting(SensorModel(width=2, height=1), 1.0, 0, 9)
    scorer = ReconstructionScorer(RenderedClip(reference, setting), task)
    assert [score.value for score in scorer.scores()] == [100.0, 100.0]
