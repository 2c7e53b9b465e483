"""Flow methods: gradients, the paper's objective, and synthetic cases with a known answer."""

import math
from dataclasses import replace
from functools import cache, partial

import cv2
import numpy as np
import pytest
from scipy.optimize import minimize

from eres_render import Camera, GroundTruth, Plane, Trajectory
from sensor import SensorModel, simulate
from tasks.errors import TaskError
from tasks.flow import (
    FlowSample,
    corners,
    find_features,
    flow_sample,
    initial_sigma_px,
    patch,
    patch_mask,
    patch_px,
    rnepe_px,
    times_before,
)
from tasks.methods import contrast_maximization, photometric_flow
from tasks.methods.contrast_maximization import search
from tasks.numerics import bicubic

SIZE = 160  # part of a 640 px sensor's view
WIDTH = 640
FLOW = np.array([11.3, -7.7])  # px a window
C = 0.2


def band_limited(seed, size, shift):
    """Return the log intensity of a periodic texture, shifted by (x, y) px; no detail below 4
    px."""
    rng = np.random.default_rng(seed)
    fy, fx = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    radius = np.hypot(fx, fy)
    spectrum = np.fft.fft2(rng.standard_normal((size, size)))
    spectrum *= np.where((radius > 0) & (radius < 0.25), 1 / np.maximum(radius, 1 / size), 0)
    image = np.fft.ifft2(spectrum * np.exp(-2j * np.pi * (fx * shift[0] + fy * shift[1]))).real
    still = np.fft.ifft2(spectrum).real
    return image / still.std() * 0.7


@cache
def translating_texture(seed=3, cutoff_hz=math.inf, warm_up_s=0.0):
    """Return events of a texture that moves by FLOW in a 50 ms window, and its image at the
    start."""
    t_s = np.linspace(-warm_up_s, 0.05, 60 + round(1200 * warm_up_s))
    frames = np.exp(np.stack([band_limited(seed, SIZE, FLOW * t / 0.05) for t in t_s]))
    model = SensorModel(
        width=SIZE, height=SIZE, contrast_threshold=C, dark_level=0.0, cutoff_hz=cutoff_hz
    )
    events = simulate(frames, t_s + warm_up_s, model)
    start_us = round(warm_up_s * 1e6)
    events = replace(events, t_us=events.t_us - start_us).between(0, 50_000)
    return events, band_limited(seed, SIZE, np.zeros(2))


@pytest.fixture(scope="module")
def translating():
    return translating_texture()


def samples(translating, count, sigma_px, seed=0):
    events, log_image = translating
    rng = np.random.default_rng(seed)
    side = patch_px(WIDTH)
    for _ in range(count):
        center = rng.uniform(30, SIZE - 30, 2)
        initial = FLOW + rng.normal(0, sigma_px, 2)
        yield flow_sample(
            events,
            0,
            50_000,
            log_image=log_image,
            contrast_threshold=C,
            center_px=center,
            side_px=side,
            initial=initial,
            initial_sigma_px=sigma_px,
        )


@pytest.mark.parametrize("warm_up_s", [0.0, 0.01])
@pytest.mark.parametrize(
    ("estimate", "bound_px"),
    [
        (photometric_flow.estimate, 0.05),
        (photometric_flow.estimate_unknown_contrast, 0.05),
        (photometric_flow.estimate_by_descent, 0.05),
        (photometric_flow.estimate_with_delay, 0.05),
        (contrast_maximization.estimate, 0.2),
        (partial(contrast_maximization.estimate, objective="gradient"), 0.2),
    ],
)
def test_recovers_the_motion_of_a_translating_texture(translating, estimate, bound_px, warm_up_s):
    """Physics: for noise-free events of a pure translation the answer is known.

    The pixels' memories start at the texture's first image, or have moved on from there. A search
    that starts more than two sigma off may end in another minimum; it then scores its start.
    """
    sigma_px = 3 * WIDTH / 1280
    moving = translating_texture(warm_up_s=warm_up_s) if warm_up_s else translating
    errors, starts = [], []
    for sample in samples(moving, 30, sigma_px):
        answer = estimate(sample)
        assert not answer.failure or np.linalg.norm(sample.initial - FLOW) > 2 * sigma_px
        errors.append(np.linalg.norm(answer.flow - FLOW))
        starts.append(np.linalg.norm(sample.initial - FLOW))
    assert np.median(starts) > 1
    assert np.median(errors) < bound_px


def test_a_slow_sensor_moves_the_flow_and_a_delay_explains_most_of_it():
    """Physics: two poles delay slow changes by 2 / a; EPF without the delay estimates another
    flow."""
    cutoff_hz = 200.0
    delay = 2 / (2 * math.pi * cutoff_hz) / 0.05  # windows
    moving = translating_texture(cutoff_hz=cutoff_hz, warm_up_s=0.01)
    without, with_delay, delays = [], [], []
    for sample in samples(moving, 20, 3 * WIDTH / 1280):
        answer = photometric_flow.estimate_with_delay(sample)
        assert not answer.failure
        delays.append(answer.delay)
        with_delay.append(np.linalg.norm(answer.flow - FLOW))
        without.append(np.linalg.norm(photometric_flow.estimate(sample).flow - FLOW))
    # The observed position lags the true one by d v, and the flow compensates for that.
    assert np.median(without) > 0.5 * delay * np.linalg.norm(FLOW)
    assert np.median(with_delay) < 0.05
    assert np.median(delays) == pytest.approx(delay, rel=0.02)


def test_a_search_on_blurred_events_goes_on_to_the_minimum():
    """Promise: a search continues while its cost decreases, and does not score its start.

    A sensor that is much slower than its texture contradicts the image everywhere: the cost is
    rough, and Levenberg-Marquardt takes many small steps.
    """
    moving = translating_texture(cutoff_hz=25.0, warm_up_s=0.04)
    around = [np.array([x, y, 0.0, 0.0]) for x in (-1, 0, 1) for y in (-1, 0, 1) if x or y]
    minima = 0
    for sample in samples(moving, 30, 3 * WIDTH / 1280):
        answer = photometric_flow.estimate(sample)
        assert answer.failure in ("", "search ended beyond its bound")
        if answer.failure:
            continue
        columns = [sample.x_px, sample.y_px, sample.t, sample.t_before, sample.p]
        events = np.stack(columns, axis=1)[np.isfinite(sample.t_before)]

        def cost(unknowns, events=events, L=sample.log_image):
            return photometric_flow.normal_equations(events, L, unknowns)[0]

        found = np.array([*answer.flow, 1 / C, 0.0])
        minima += 1
        assert cost(found) <= min(cost(found + 0.1 * step) for step in around)
    assert minima > 15


def test_contrast_need_not_be_known(translating):
    """Promise: the scale-free objective gives the same flow for any C of the sample."""
    (sample,) = samples(translating, 1, 1.0)
    wrong = replace(sample, contrast_threshold=2 * C)
    free = photometric_flow.estimate_unknown_contrast
    np.testing.assert_array_equal(free(wrong).flow, free(sample).flow)
    error_px = np.linalg.norm(free(wrong).flow - FLOW)
    assert np.linalg.norm(photometric_flow.estimate(wrong).flow - FLOW) > 10 * error_px


def sampled(image, x, y):
    """Return the values and gradients (3, N) of an image at points."""
    out = np.empty((3, len(x)))
    bicubic.sample_all(image, x, y, out)
    return out


def test_bicubic_gradient_is_that_of_its_value():
    """Promise: the analytic gradient agrees with differences, and pixels are reproduced."""
    image, h = np.random.default_rng(0).normal(size=(9, 11)), 1e-6
    assert sampled(image, np.array([4.5]), np.array([3.5]))[0, 0] == pytest.approx(image[3, 4])
    x, y = np.random.default_rng(1).uniform(-1, 12, (2, 200))
    _, dx, dy = sampled(image, x, y)
    for gradient, (i, j) in ((dx, (h, 0)), (dy, (0, h))):
        there, back = sampled(image, x + i, y + j)[0], sampled(image, x - i, y - j)[0]
        np.testing.assert_allclose(gradient, (there - back) / (2 * h), atol=1e-6)


@pytest.mark.parametrize(("low", "high"), [(-3, 40), (5, 20)])
def test_bicubic_values_are_a_convolution_with_keys_kernel(low, high):
    """Promise: values are a sum over all pixels with the kernel of Keys (1981), edges repeated."""
    image = np.random.default_rng(0).normal(size=(29, 37))
    x, y = np.random.default_rng(1).uniform(low, high, (2, 300))

    def kernel(at, pixels):
        d = np.abs(at[:, None] - (np.arange(-14, pixels + 14) + 0.5))
        near, far = (1.5 * d - 2.5) * d * d + 1, ((-0.5 * d + 2.5) * d - 4) * d + 2
        return np.where(d < 1, near, np.where(d < 2, far, 0))

    padded = np.pad(image, 14, mode="edge")
    expected = np.einsum("nj,ji,ni->n", kernel(y, 29), padded, kernel(x, 37))
    np.testing.assert_allclose(sampled(image, x, y)[0], expected, rtol=0, atol=1e-13)


def test_photometric_cost_does_not_depend_on_the_order_of_events(translating):
    """Promise: a point that two events share is sampled once and counts twice."""
    (sample,) = samples(translating, 1, 1.0)
    by_time = photometric_events(sample)
    by_pixel = by_time[np.lexsort((by_time[:, 2], by_time[:, 0], by_time[:, 1]))]
    assert np.any(by_pixel[1:, 3] == by_pixel[:-1, 2])
    at = np.array([10.0, -7.0, 4.0, 0.02])
    for one, other in zip(
        photometric_flow.normal_equations(by_time, sample.log_image, at),
        photometric_flow.normal_equations(by_pixel, sample.log_image, at),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def photometric_events(sample):
    usable = np.isfinite(sample.t_before)
    columns = (sample.x_px, sample.y_px, sample.t, sample.t_before, sample.p)
    return np.stack([column[usable] for column in columns], axis=1)


def test_photometric_gradient_is_that_of_its_cost(translating):
    """Promise: gradient and curvature in flow, 1 / C and delay agree with differences."""
    (sample,) = samples(translating, 1, 1.0)
    events = photometric_events(sample)
    at = np.array([10.0, -7.0, 4.0, 0.02])

    def equations(unknowns):
        return photometric_flow.normal_equations(events, sample.log_image, unknowns)

    def residuals(unknowns):
        x, y, t, t_before, p = events.T
        vx, vy, gain, delay = unknowns
        L1, L0 = (
            sampled(sample.log_image, x - vx * s, y - vy * s)[0]
            for s in (t - delay, t_before - delay)
        )
        return gain * p * (L1 - L0) - 1

    cost, gradient, curvature = equations(at)
    assert cost == pytest.approx(np.sum(residuals(at) ** 2))
    steps = np.diag([1e-5, 1e-5, 1e-5, 1e-6])
    jacobian = np.stack(
        [(residuals(at + h) - residuals(at - h)) / (2 * h.sum()) for h in steps], axis=1
    )
    np.testing.assert_allclose(gradient, jacobian.T @ residuals(at), rtol=1e-5)
    np.testing.assert_allclose(curvature, jacobian.T @ jacobian, rtol=1e-5, atol=1e-4)


def test_the_printed_objective_is_minimal_at_rest_and_ours_is_not(translating):
    """Finding: with the best C inserted, Eq. (11) is 0 at v = 0, for any events.

    With C known, or scale-free, rest has the worst possible objective, and the truth a far better
    one.
    """
    (sample,) = samples(translating, 1, 1.0)
    events = photometric_events(sample)
    gains = np.append(0, 1 / np.linspace(*photometric_flow.CONTRAST_BOUNDS, 400))

    def steps(v):  # p Delta L of each event
        x, y, t, t_before, p = events.T
        L1, L0 = (sampled(sample.log_image, x - v[0] * s, y - v[1] * s)[0] for s in (t, t_before))
        return p * (L1 - L0)

    def printed(v):
        best_C = np.mean(steps(v))  # Eq. (12)
        return np.mean((steps(v) - best_C) ** 2)

    def known(v):
        return np.mean((steps(v) / C - 1) ** 2)

    def scale_free(v):
        found = steps(v)
        return min(np.mean((gain * found - 1) ** 2) for gain in gains)

    rest = np.zeros(2)
    assert printed(rest) == 0 < printed(FLOW)
    assert known(FLOW) < 0.1 < known(rest) == 1
    assert scale_free(FLOW) < 0.1 < scale_free(rest) == 1
    unknowns = np.array([*FLOW, 1 / C, 0.0])
    cost = photometric_flow.normal_equations(events, sample.log_image, unknowns)[0]
    assert cost / len(events) == pytest.approx(known(FLOW))


def votes(column, row, shape):
    """Return bilinear votes of points, computed slowly."""
    image = np.zeros(shape)
    for x, y in zip(column, row, strict=True):
        for j in (math.floor(y), math.floor(y) + 1):
            for i in (math.floor(x), math.floor(x) + 1):
                image[j, i] += (1 - abs(x - i)) * (1 - abs(y - j))
    return image


@pytest.mark.parametrize("at_bound", [False, True])
@pytest.mark.parametrize("objective", ["variance", "gradient", "plain variance"])
def test_contrast_is_that_of_a_slow_reference(translating, objective, at_bound):
    """Promise: votes minus those of an even distribution, blurred by 1 px, squared or their slopes;
    the plain variance is that of the blurred votes alone, but for a constant.

    No vote is lost, and no part of its blur, at the flow that is farthest from zero either.
    """
    (sample,) = samples(translating, 1, 1.0)
    sample = replace(sample, **{k: getattr(sample, k)[::7] for k in ("x_px", "y_px", "t")})
    reach, far = 20.0, 40
    flow = sample.initial + reach * np.sign(sample.initial) if at_bound else np.array([9.0, 6.0])
    (left, top), (right, bottom) = sample.patch
    shape = (bottom - top + 2 * far, right - left + 2 * far)

    def warped(x_px, y_px, t):
        column = x_px - 0.5 - left + far - flow[0] * (t - 0.5)
        row = y_px - 0.5 - top + far - flow[1] * (t - 0.5)
        return votes(column, row, shape)

    y_px, x_px = np.mgrid[top:bottom, left:right].reshape(2, -1) + 0.5
    fast = contrast_maximization.Contrast(sample, reach, objective)
    exposures = 29  # at most a pixel apart, for flows of up to 20 px from the initial one
    assert len(fast.patch.exposure_t) >= exposures
    even = sum(warped(x_px, y_px, np.full(x_px.shape, t + 0.5)) for t in fast.patch.exposure_t)
    mean = len(sample.t) / x_px.size
    image = warped(sample.x_px, sample.y_px, sample.t)
    if objective != "plain variance":
        image -= mean * even / len(fast.patch.exposure_t)
    image = cv2.GaussianBlur(image, (9, 9), 1.0)
    dy, dx = np.gradient(image)
    total = np.sum(dx**2 + dy**2 if objective == "gradient" else image**2)
    if objective == "plain variance":
        total = image.size * (image.var() + (len(sample.t) / image.size) ** 2)
    assert fast(flow) == pytest.approx(total / x_px.size / mean**2, rel=1e-9)


@pytest.mark.parametrize("objective", ["variance", "gradient"])
def test_the_search_is_that_of_scipy(translating, objective):
    """Oracle: SciPy's Nelder-Mead makes as many images and ends at the same flow, to the bit.

    One search starts far off, and one has a bound that it meets.
    """
    (moving,) = samples(translating, 1, 1.0)
    random = noise(np.random.default_rng(0), 2)
    for sample, reach, size in (
        (moving, 6.0, 0.75),
        (replace(moving, initial=FLOW + 4), 6.0, 0.75),
        (replace(moving, initial=FLOW + 1), 0.7, 0.4),
        (random, 16.0, 2.0),
        (random, 16.0, 1e-3),  # the first simplex has converged
    ):
        contrast = contrast_maximization.Contrast(sample, reach, objective)

        def loss(offset, contrast=contrast, sample=sample, reach=reach):
            far = max(abs(offset[0]), abs(offset[1])) > reach
            return 0.0 if far else -contrast(sample.initial + offset)

        best = minimize(
            loss,
            np.zeros(2),
            method="Nelder-Mead",
            options={
                "initial_simplex": np.array([[0.0, 0.0], [size, 0.0], [0.0, size]]),
                "xatol": search.CONVERGED_PX,
                "fatol": np.inf,
                "maxfev": search.MAX_IMAGES,
            },
        )
        simplex = np.array([[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0]])
        inputs = contrast.patch, contrast.work, sample.initial, reach
        made = search.find_sharpest(*inputs, simplex)
        np.testing.assert_array_equal(simplex[0], [*best.x, best.fun])
        assert made == best.nfev


def noise(rng, per_px, initial=(0.0, 0.0), sigma_px=4.0):
    """Return events at random places and times in a patch of 31 px and its window."""
    area = patch(np.array([50.0, 50.0]), 31, 100, 100)
    count = per_px * 31**2
    x, y = (rng.integers(first, last, count) for first, last in area.T)
    nothing = np.full(count, np.nan)
    return FlowSample(
        x_px=x + 0.5,
        y_px=y + 0.5,
        t=np.sort(rng.uniform(0, 1, count)),
        t_before=nothing,
        p=np.ones(count, np.int8),
        log_image=np.zeros((100, 100)),
        contrast_threshold=C,
        center_px=np.array([50.0, 50.0]),
        patch=area,
        initial=np.array(initial),
        initial_sigma_px=sigma_px,
    )


def test_no_flow_scores_on_events_without_texture():
    """Physics: a patch's edges and the scatter of its events favor no flow, small or large.

    Random events add 1 / 4 pi / (events per pixel) to the contrast, the integral of a Gaussian of 1
    px squared; bilinear votes blur a little more.
    """
    rng = np.random.default_rng(0)
    flows = np.array([[0, 0], [5, 0], [-3, 9], [15, 0], [12, -15.5]])
    trials = []
    for _ in range(20):
        contrast = contrast_maximization.Contrast(noise(rng, 4), 16.0)
        trials.append([contrast(flow) for flow in flows])
    mean, error = np.mean(trials, axis=0), np.std(trials, axis=0) / math.sqrt(len(trials))
    assert 0.7 / (16 * math.pi) < mean.mean() < 1 / (16 * math.pi)
    moving = mean[1:]  # at rest votes fall on pixel centers, and are not blurred further
    assert np.ptp(moving) < 4 * error.max()
    assert np.all(moving < mean[0])


@pytest.mark.parametrize(
    ("method", "reason"),
    [
        (contrast_maximization, "search ended at its bound"),
        (photometric_flow, "search ended beyond its bound"),
    ],
)
def test_a_search_that_goes_far_is_a_counted_failure(translating, method, reason):
    """Promise: an answer beyond four sigma fails; the initial flow remains, with the reason."""
    (sample,) = samples(translating, 1, 1.0)
    away = replace(sample, initial=FLOW + np.array([2.0, 0.0]), initial_sigma_px=0.4)
    answer = method.estimate(away)
    assert answer.failure == reason
    np.testing.assert_array_equal(answer.flow, away.initial)
    assert not method.estimate(replace(away, initial_sigma_px=0.6)).failure


@pytest.mark.parametrize("spoiled", [np.nan, -np.inf, None])
def test_images_without_a_gradient_are_a_failure(translating, spoiled):
    """Promise: descent, too, has no answer where the image is flat or has a pixel without light."""
    (sample,) = samples(translating, 1, 1.0)
    image = np.zeros_like(sample.log_image) if spoiled is None else sample.log_image.copy()
    if spoiled is not None:
        image[image.shape[0] // 2, image.shape[1] // 2] = spoiled
    for estimate in (photometric_flow.estimate, photometric_flow.estimate_by_descent):
        answer = estimate(replace(sample, log_image=image))
        assert answer.failure
        np.testing.assert_array_equal(answer.flow, sample.initial)


def test_too_few_events_is_a_counted_failure(translating):
    """Promise: a patch with too few events gets the reason and keeps its initial flow."""
    events, log_image = translating
    for method in (photometric_flow, contrast_maximization):
        center = np.array([50.0, 50.0])
        sample = flow_sample(events[:0], 0, 50_000, log_image, C, center, 31, FLOW + 1, 1.0)
        answer = method.estimate(sample)
        assert "events" in answer.failure
        np.testing.assert_array_equal(answer.flow, FLOW + 1)


def test_times_before_are_those_of_the_same_pixel():
    """Promise: each event has the time of the previous event at its own pixel."""
    pixel = np.array([3, 1, 3, 3, 1, 2])
    t = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    expected = [np.nan, np.nan, 0.1, 0.3, 0.2, np.nan]
    np.testing.assert_array_equal(times_before(pixel, t), expected)


def test_patches_shrink_with_the_sensor_and_errors_are_normalized():
    """Promise: 61 px at 1280, odd, at least 7; an error counts by the field of view it spans."""
    assert [patch_px(w) for w in (128, 240, 346, 640, 1280)] == [7, 11, 17, 31, 61]
    assert [patch_px(w, native=True) for w in (128, 1280)] == [61, 61]
    assert rnepe_px(np.array([1.0, 1.0]), np.array([1.0, 1.5]), 640) == pytest.approx(1.0)


def test_patches_are_cut_at_the_sensors_edge(translating):
    """Promise: a patch has the pixels with the nearest centers, except those off the sensor."""
    np.testing.assert_array_equal(patch(np.array([50.2, 40.5]), 7, 128, 128), [[47, 37], [54, 44]])
    np.testing.assert_array_equal(patch(np.array([5.0, 125.0]), 61, 128, 128), [[0, 95], [36, 128]])
    mask = patch_mask(np.array([[5.0, 5.0], [60.0, 60.0]]), 61, 128, 128)
    assert mask.sum() == 36**2 + 61**2 - 6**2  # which overlap by 6 x 6
    events, log_image = translating
    at = partial(
        flow_sample,
        start_us=0,
        end_us=50_000,
        log_image=log_image,
        contrast_threshold=C,
        center_px=np.array([5.0, 5.0]),
        side_px=31,
        initial=FLOW,
        initial_sigma_px=1.0,
    )
    at_corner = at(events)
    kept = events.where(patch_mask(np.array([[5.0, 5.0]]), 31, SIZE, SIZE)[events.y, events.x])
    assert 0 < len(kept) == len(at_corner.t) < len(events)
    np.testing.assert_array_equal(at(kept).t_before, at_corner.t_before)
    assert at_corner.x_px.max() == 20.5


def test_corners_of_a_checkerboard():
    """Promise: where squares meet, pixel centers are at integers + 0.5; none on an even image."""
    y, x = np.mgrid[:320, :320]
    board = 0.2 + 0.6 * (((x // 40) + (y // 40)) % 2)
    found = corners(board, 50)
    assert len(found) == 25
    assert np.abs((found + 20) % 40 - 20).max() < 3
    assert corners(np.ones((100, 100)), 10).shape == (0, 2)


def sliding_camera(distance=None):
    """Return a camera that slides by 0.1 m/s in x, 1 m from a wall; 100 px wide, f = 86.6 px."""
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = 0.1 * (np.arange(5) - 1.0)
    wall = Plane((0.0, 0.0, 1.0), 1.0)
    path = Trajectory(np.arange(5) - 1.0, poses)
    camera = Camera(100, 100, math.radians(60))
    return GroundTruth(path, camera, distance or wall.distance, wall)


def wall_behind_a_post(origin, way):
    """The wall at 1 m, and a post half a meter nearer over x > 0.05 m."""
    to_post = 0.5 / way[:, 2]
    return np.where(origin[0] + to_post * way[:, 0] > 0.05, to_post, 1.0 / way[:, 2])


def test_features_have_the_flow_of_the_geometry():
    """Physics: a wall at 1 m passes a camera of f px at 0.1 m/s by 0.1 f px per second, evenly."""
    rng = np.random.default_rng(5)
    image = cv2.GaussianBlur(rng.uniform(0, 1, (100, 100)), (0, 0), 2)
    truth = sliding_camera()
    features = find_features(image, truth, (0.2, 0.7), ("wall", 3), count=6)
    speed_px = 0.1 * truth.camera(100).focal_px
    np.testing.assert_allclose(features.flow_px, np.tile([-0.5 * speed_px, 0.0], (6, 1)), atol=1e-9)
    arrived = cv2.perspectiveTransform(features.centers_px[None], truth.homography(0.2, 0.7, 100))[
        0
    ]
    np.testing.assert_allclose(features.centers_px + features.flow_px, arrived, atol=1e-9)
    coarse = features.at(40)
    np.testing.assert_allclose(coarse.centers_px, 0.4 * features.centers_px)
    np.testing.assert_allclose(coarse.flow_px, 0.4 * features.flow_px)


def test_features_that_do_not_stay_in_sight_are_passed_over():
    """Promise: a point that is hidden, or leaves the image, within the window is not a feature."""
    rng = np.random.default_rng(5)
    image = cv2.GaussianBlur(rng.uniform(0, 1, (100, 100)), (0, 0), 2)
    free = find_features(image, sliding_camera(), (0.0, 1.0), ("wall", 0), count=60)
    truth = sliding_camera(wall_behind_a_post)
    seen = find_features(image, truth, (0.0, 1.0), ("wall", 0), count=40)
    # The post's edge moves by twice as much as the wall, from its 8.7 px right of the middle on.
    edge_px = 50 + 0.05 / 0.5 * truth.camera(100).focal_px
    end = seen.centers_px + seen.flow_px
    on_wall = seen.centers_px[:, 0] < edge_px
    assert np.all(end[on_wall, 0] < edge_px - 17.3 + 1e-6)
    np.testing.assert_allclose(seen.flow_px[~on_wall, 0], -17.3, atol=0.03)
    hidden = free.centers_px[:, 0] < edge_px
    hidden &= free.centers_px[:, 0] + free.flow_px[:, 0] > edge_px - 17.3
    assert hidden.any()
    assert not set(map(tuple, free.centers_px[hidden])) & set(map(tuple, seen.centers_px))
    with pytest.raises(TaskError, match=r"\d+ of \d+ corners .* expected 1000"):
        find_features(image, truth, (0.0, 1.0), ("wall", 0), count=1000)


def test_initial_flows_are_drawn_once_for_all_sensors():
    """Promise: sensors share the same draws, which scale; scenes and samples have their own."""
    rng = np.random.default_rng(5)
    image = cv2.GaussianBlur(rng.uniform(0, 1, (100, 100)), (0, 0), 2)
    find = partial(find_features, image, sliding_camera(), (0.2, 0.7))
    features = find(("wall", 3), count=6)
    off_px = {w: features.at(w).initial_flow_px() - features.at(w).flow_px for w in (128, 1280)}
    np.testing.assert_allclose(off_px[128], 0.1 * off_px[1280])
    np.testing.assert_allclose(off_px[1280], 3 * features.draws)
    assert initial_sigma_px(640) == 1.5
    np.testing.assert_array_equal(find(("wall", 3), count=4).draws, features.draws[:4])
    for other in (find(("wall", 4), count=6), find(("w", 3), count=6)):
        assert not np.any(other.draws == features.draws)
    assert not np.any(find(("wall", 3), count=6, seed=1).draws == features.draws)
