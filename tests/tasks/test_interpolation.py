"""Frames in between lie where the motion says, to a small part of a pixel."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from in_memory import footage_of
from tasks.footage.interpolation import interpolated
from tasks.footage.warping import blend, coefficients, find_later


def linear(image, dx, dy):
    """Sample an image at distances from its pixels; the border is repeated."""
    y, x = np.indices(image.shape)
    return map_coordinates(image.astype(float), (y + dy, x + dx), order=1, mode="nearest")


def o_moms(x):
    """The cubic O-MOMS kernel, Blu, Thevenaz and Unser 2001."""
    x = np.abs(x)
    inner = 13 / 21 + x / 14 - x**2 + x**3 / 2
    outer = 29 / 21 - 85 / 42 * x + x**2 - x**3 / 6
    return np.where(x < 1, inner, np.where(x < 2, outer, 0))


def along_columns(image, at):
    """Interpolate every column of an image at (N,) rows: (N, W)."""
    count = len(image)
    padded = np.pad(np.eye(count), ((2, 2), (0, 0)), mode="reflect")  # mirrored coefficients
    places = np.arange(-2, count + 2)
    values_of = o_moms(np.arange(count)[:, None] - places) @ padded
    return o_moms(at[:, None] - places) @ (padded @ np.linalg.solve(values_of, image))


def smooth(image, dx, dy):
    """As `linear`, with O-MOMS."""
    height, width = image.shape
    y, x = np.indices(image.shape)
    rows = np.clip(y + dy, 0, height - 1).ravel()
    columns = np.clip(x + dx, 0, width - 1).ravel()
    lines = along_columns(image.astype(float), rows)
    weights = along_columns(np.eye(width), columns)
    return np.einsum("nx,nx->n", lines, weights).reshape(image.shape)


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (33, 1), (2, 3), (7, 64), (9, 131), (140, 9)])
@pytest.mark.parametrize("motion_px", [0.0, 0.4, 6.0, 500.0])
def test_the_kernels_equal_their_reference(size, motion_px):
    """Reference: NumPy and SciPy in double precision, for sides and times of any size, rows from
    anywhere, and motion that is uneven and leaves the image."""
    rng = np.random.default_rng(sum(size) + int(motion_px))
    first, second = rng.random((2, *size), np.float32)
    flow = (motion_px * rng.normal(size=(*size, 2))).astype(np.float32)
    later = np.empty_like(flow)
    find_later(flow, later)
    expected = flow.astype(float)
    for _ in range(2):
        dx, dy = -np.moveaxis(expected, 2, 0)
        expected = np.stack([linear(flow[..., k], dx, dy) for k in range(2)], axis=2)
    np.testing.assert_allclose(later, expected, atol=2e-6 * (1 + motion_px) ** 2)
    for t in (1e-3, 0.25, 0.9):
        start = int(t * size[0])
        frame = np.empty((size[0] - start, size[1]), np.float32)
        blend(coefficients(first), coefficients(second), flow, later, t, start, frame)
        u, v = np.moveaxis((1 - t) * flow.astype(float) + t * later, 2, 0)
        parts = smooth(first, -t * u, -t * v), smooth(second, (1 - t) * u, (1 - t) * v)
        expected = np.maximum((1 - t) * parts[0] + t * parts[1], 0)[start:]
        np.testing.assert_allclose(frame, expected, atol=2e-6 * (1 + motion_px))


def test_the_flow_of_a_zoom_is_that_of_where_it_leads():
    """Analytic: points move from q to p = 1.02 q, so that the flow at p is 0.02 / 1.02 p."""
    y, x = np.mgrid[:60, :80].astype(np.float32)
    at = np.stack([x, y], axis=2)
    later = np.empty_like(at)
    find_later(0.02 * at, later)
    np.testing.assert_allclose(later, 0.02 / 1.02 * at, atol=1e-3)


@pytest.mark.parametrize(
    ("period_px", "error"), [(3, 0.1), (4, 0.02), (6, 2e-3), (8, 6e-4), (16, 3e-5)]
)
def test_a_wave_is_sampled_at_any_fraction_of_a_pixel(period_px, error):
    """Analytic: a moving sinusoid. Positions that were rounded to 1/32 px, as by OpenCV, would be
    wrong by 6e-3 at a period of 16 px."""
    x = np.mgrid[:24, :160][1]

    def wave(shift_px):
        return (2 + np.sin(2 * np.pi * (x - shift_px) / period_px)).astype(np.float32)

    flow = np.zeros((24, 160, 2), np.float32)
    flow[..., 0] = 5.3
    for t in np.linspace(0.01, 0.99, 23):
        frame = np.empty((24, 160), np.float32)
        blend(coefficients(wave(0)), coefficients(wave(5.3)), flow, flow, t, 0, frame)
        inside = slice(12, -12)
        np.testing.assert_allclose(frame[:, inside], wave(5.3 * t)[:, inside], atol=error)


def test_a_thing_passes_before_its_background():
    """Promise: where the background appears and vanishes, frames in between are still nearer to the
    truth than blended frames."""
    rng = np.random.default_rng(0)
    cloth, card = (gaussian_filter(rng.normal(size=(160, 260)), 2) for _ in range(2))
    cloth, card = (0.5 + 0.1 * one / one.std() for one in (cloth, card))
    y, x = np.mgrid[:120, :160]

    def picture(t):
        behind = map_coordinates(cloth, (y + 20.0, x + 50 - 6 * t), mode="mirror")
        front = map_coordinates(card, (y + 20.0, x + 50 + 6 * t), mode="mirror")
        inside = np.clip(35 - np.hypot(x - 80 + 6 * t, y - 60), 0, 1)
        return (behind + inside * (front - behind)).astype(np.float32)

    ends = picture(0), picture(1)
    around = np.abs(np.hypot(x - 77, y - 60) - 35) < 10
    for k, frame in enumerate(interpolated(footage_of(ends), [4])):
        blended = ends[0] + k / 4 * (ends[1] - ends[0])
        error, usual = (np.abs(one - picture(k / 4))[around].mean() for one in (frame, blended))
        assert error <= 0.35 * usual, k


@pytest.mark.parametrize("size", [(1, 1), (1, 90), (90, 1), (70, 95)])
def test_frames_of_any_size_and_steps_are_divided(size):
    """Promise: own frames are kept to the bit, there are as many as times, and all are finite and
    not negative, also for a cut, and for black and white."""
    rng = np.random.default_rng(0)
    frames = [rng.random(size, np.float32), np.zeros(size, np.float32), np.ones(size, np.float32)]
    dense = interpolated(footage_of([*frames, frames[0]]), [1, 5, 2])
    found = np.stack(list(dense))
    assert len(found) == len(dense) == 9
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    for k, own in ((0, 0), (1, 1), (6, 2), (8, 0)):
        np.testing.assert_array_equal(found[k], frames[own])
