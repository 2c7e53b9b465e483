"""Flow methods: gradients, the paper's objective, and made-up cases with a known answer."""

from functools import partial

import numpy as np
import pytest

from sensor import SensorModel, simulate
from tasks.errors import TaskError
from tasks.flow import (
    features_px,
    flow_sample,
    patch_px,
    rnepe_px,
    times_before,
)
from tasks.methods import bicubic, contrast_maximization, photometric_flow

SIZE = 160  # part of a 640 px sensor's view
WIDTH = 640
FLOW = np.array([11.3, -7.7])  # px a window
C = 0.2


def band_limited(seed, size, shift):
    """Log intensity of a periodic texture with no detail below 4 px, shifted by (x, y) px."""
    rng = np.random.default_rng(seed)
    fy, fx = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    radius = np.hypot(fx, fy)
    spectrum = np.fft.fft2(rng.standard_normal((size, size)))
    spectrum *= np.where((radius > 0) & (radius < 0.25), 1 / np.maximum(radius, 1 / size), 0)
    image = np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (fx * shift[0] + fy * shift[1]))).real
    still = np.fft.ifft2(spectrum).real
    return image / still.std() * 0.7


@pytest.fixture(scope="module")
def translating():
    """Events of a texture that moves by FLOW in a 50 ms window, and its image at the start."""
    t_s = np.linspace(0, 0.05, 60)
    frames = np.exp(np.stack([band_limited(3, SIZE, FLOW * t / 0.05) for t in t_s]))
    model = SensorModel(width=SIZE, height=SIZE, contrast_threshold=C, dark_level=0.0)
    return simulate(frames, t_s, model), np.log(frames[0])


def samples(translating, count, sigma_px, seed=0):
    events, log_image = translating
    rng = np.random.default_rng(seed)
    side = patch_px(WIDTH)
    for _ in range(count):
        centre = rng.uniform(30, SIZE - 30, 2)
        initial = FLOW + rng.normal(0, sigma_px, 2)
        yield flow_sample(events, 0, 50_000, log_image, C, centre, side, initial, sigma_px)


@pytest.mark.parametrize(
    ("estimate", "bound_px"),
    [
        (photometric_flow.estimate, 0.05),
        (contrast_maximization.estimate, 0.2),
        (partial(contrast_maximization.estimate, objective="gradient"), 0.2),
    ],
)
def test_recovers_the_motion_of_a_translating_texture(translating, estimate, bound_px):
    """Physics: on noise-free events of a pure translation the answer is known."""
    sigma_px = 3 * WIDTH / 1280
    errors, starts = [], []
    for sample in samples(translating, 50, sigma_px):
        answer = estimate(sample)
        assert not answer.failure
        errors.append(np.linalg.norm(answer.flow - FLOW))
        starts.append(np.linalg.norm(sample.initial - FLOW))
    assert np.median(starts) > 1
    assert np.median(errors) < bound_px


def test_bicubic_gradient_is_that_of_its_value():
    """Promise: the analytic gradient agrees with differences, and pixels are reproduced."""
    image = np.random.default_rng(0).normal(size=(9, 11))
    assert bicubic.sample(image, 4.5, 3.5)[0] == pytest.approx(image[3, 4])
    h = 1e-6
    for x, y in np.random.default_rng(1).uniform(-1, 12, (200, 2)):
        _, dx, dy = bicubic.sample(image, x, y)
        left, right = bicubic.sample(image, x - h, y)[0], bicubic.sample(image, x + h, y)[0]
        above, below = bicubic.sample(image, x, y - h)[0], bicubic.sample(image, x, y + h)[0]
        assert dx == pytest.approx((right - left) / (2 * h), abs=1e-6)
        assert dy == pytest.approx((below - above) / (2 * h), abs=1e-6)


def test_photometric_gradient_is_that_of_its_cost(translating):
    """Promise: the normal equations' gradient agrees with differences of the cost."""
    (sample,) = samples(translating, 1, 1.0)
    usable = np.isfinite(sample.t_before)
    events = np.stack([sample.x_px, sample.y_px, sample.t, sample.t_before, sample.p])[:, usable]
    vx, vy, h = 10.0, -7.0, 1e-5

    def cost(vx, vy):
        return photometric_flow.normal_equations(events, sample.log_image, C, vx, vy)[0]

    _, gx, gy, *_ = photometric_flow.normal_equations(events, sample.log_image, C, vx, vy)
    assert gx == pytest.approx((cost(vx + h, vy) - cost(vx - h, vy)) / (4 * h), rel=1e-4)
    assert gy == pytest.approx((cost(vx, vy + h) - cost(vx, vy - h)) / (4 * h), rel=1e-4)


def test_the_printed_objective_is_minimal_at_rest(translating):
    """Finding: with the best C put in, Eq. (11) is 0 at v = 0, whatever the events say."""
    (sample,) = samples(translating, 1, 1.0)
    usable = np.isfinite(sample.t_before)

    def substituted(v):
        points = [
            (x - v * t, x - v * s)
            for x, t, s in zip(
                np.stack([sample.x_px, sample.y_px], axis=1)[usable],
                sample.t[usable],
                sample.t_before[usable],
                strict=True,
            )
        ]
        image = sample.log_image
        step = np.array(
            [bicubic.sample(image, *a)[0] - bicubic.sample(image, *b)[0] for a, b in points]
        )
        best_C = np.mean(sample.p[usable] * step)  # Eq. (12)
        return np.sum((sample.p[usable] * step - best_C) ** 2)

    assert substituted(np.zeros(2)) == 0
    assert substituted(FLOW) > 0


def test_too_few_events_is_a_counted_failure(translating):
    """Promise: a starved patch is marked with the reason and keeps its initial flow."""
    events, log_image = translating
    for method in (photometric_flow, contrast_maximization):
        sample = flow_sample(
            events[:0], 0, 50_000, log_image, C, np.array([50.0, 50.0]), 31, FLOW + 1, 1.0
        )
        answer = method.estimate(sample)
        assert "events" in answer.failure
        np.testing.assert_array_equal(answer.flow, FLOW + 1)


def test_times_before_are_those_of_the_same_pixel():
    """Promise: each event knows the one before it at its own pixel."""
    pixel = np.array([3, 1, 3, 3, 1, 2])
    t = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    expected = [np.nan, np.nan, 0.1, 0.3, 0.2, np.nan]
    np.testing.assert_array_equal(times_before(pixel, t), expected)


def test_patches_shrink_with_the_sensor_and_errors_are_normalised():
    """Promise: 61 px at 1280, odd, at least 7; an error counts by the field of view it spans."""
    assert [patch_px(w) for w in (128, 240, 346, 640, 1280)] == [7, 11, 17, 31, 61]
    assert [patch_px(w, native=True) for w in (128, 1280)] == [61, 61]
    assert rnepe_px(np.array([1.0, 1.0]), np.array([1.0, 1.5]), 640) == pytest.approx(1.0)


def test_features_are_corners_within_the_margin():
    """Promise: corners of a checkerboard, pixel centres at integers + 0.5; too few is an error."""
    y, x = np.mgrid[:320, :320]
    board = 0.2 + 0.6 * (((x // 40) + (y // 40)) % 2)
    found = features_px(board, 9, 50)
    assert found.shape == (9, 2)
    assert np.all((found > 50) & (found < 270))
    assert np.abs((found + 20) % 40 - 20).max() < 3
    with pytest.raises(TaskError, match="found 0 corners"):
        features_px(np.ones((100, 100)), 5, 10)
