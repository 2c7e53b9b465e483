"""Lenses: projection and its inverse against OpenCV, and lenses that no image can have."""

import math

import cv2
import numpy as np
import pytest

from eres_render import Camera, Distortion, RenderError

LENSES = {
    "barrel": Distortion(k1=-0.3, k2=0.1),
    "all five": Distortion(k1=-0.25, k2=0.08, p1=0.001, p2=-0.0007, k3=0.01),
    "pincushion": Distortion(k1=0.2, k2=-0.05, p1=-0.002, p2=0.001),
}
SIZE = {"width": 640, "height": 360, "fx": 450.0, "fy": 440.0, "cx": 300.0, "cy": 185.0}


def opencv(camera):
    """Return OpenCV's camera matrix and coefficients: it counts from the first pixel's center."""
    d = camera.distortion
    K = np.array([[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]])
    return K, np.array([d.k1, d.k2, d.p1, d.p2, d.k3])


@pytest.fixture(params=LENSES)
def camera(request):
    return Camera(**SIZE, distortion=LENSES[request.param])


def test_points_are_projected_as_opencv_does(camera):
    """Promise: within the field of view project equals cv2.projectPoints, half a pixel apart."""
    points = camera.rays(camera.grid(20)) * np.random.default_rng(0).uniform(0.5, 3, (400, 1))
    there, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), *opencv(camera))
    np.testing.assert_allclose(camera.project(points), there.reshape(-1, 2) + 0.5, atol=1e-9)


def test_pixels_are_undistorted_as_opencv_does(camera):
    """Promise: the table equals OpenCV's undistortion, iterated until it no longer changes."""
    centers = camera.centers()[:: camera.width // 9]
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-14)
    expected = cv2.undistortImagePoints(centers - 0.5, *opencv(camera), arg1=stop)
    table = camera.undistorted_positions()
    found = table.reshape(-1, 2)[:: camera.width // 9]
    np.testing.assert_allclose(found, expected.reshape(-1, 2) + 0.5, atol=1e-8)
    assert table.shape == (360, 640, 2)
    assert camera.undistorted_positions() is table
    assert not table.flags.writeable


def test_rays_undo_projection_and_distort_undoes_undistort(camera):
    """Promise: to 1e-12 of the image plane at distance 1, also beyond the image."""
    pixels = np.random.default_rng(1).uniform(-20, 660, (500, 2)) * (1, 360 / 640)
    assert abs(camera.project(2.5 * camera.rays(pixels)) - pixels).max() < 1e-9
    assert abs(camera.distort(camera.undistort(pixels)) - pixels).max() < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_no_direction_is_folded_into_the_image(seed):
    """Promise: far outside the field of view, where the polynomials turn back, points stay out.

    Expected: distort is one to one on the whole plane, so undistort finds every direction again.
    """
    rng = np.random.default_rng(seed)
    k1, k2, k3 = rng.normal(0, (0.3, 0.1, 0.02)).tolist()
    lens = Distortion(-abs(k1), k2, *rng.normal(0, 2e-3, 2).tolist(), k3)
    xy = rng.normal(0, 3, (2000, 2))
    np.testing.assert_allclose(lens.undistort(lens.distort(xy)), xy, rtol=0, atol=1e-7)
    angle = rng.uniform(0, 2 * math.pi, 500)
    axes = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    radii = np.linspace(0, min(4 * lens.reach, 50), 200)
    seen = np.hypot(*np.moveaxis(lens.distort(radii[:, None, None] * axes), -1, 0))
    assert np.all(np.diff(seen, axis=0) > 0)


def test_the_reach_is_where_the_radial_polynomial_turns():
    """Analytic: r - r^3 / 5 grows until r^2 = 5 / 3; r + r^3 grows forever."""
    assert Distortion(k1=-0.2).reach == pytest.approx(math.sqrt(5 / 3), rel=1e-12)
    assert math.isinf(Distortion(k1=1.0).reach)
    assert Distortion(p1=3e-3, p2=4e-3).reach == pytest.approx(1 / 0.03, rel=1e-9)
    for k3 in (1e-80, -1e-100, 1e-320):
        assert Distortion(k1=-0.2, k3=k3).reach == pytest.approx(math.sqrt(5 / 3), rel=1e-9)


def test_a_lens_that_folds_the_image_is_refused():
    """Analytic: at f = 500 the image of r - r^3 / 2 ends 500 * sqrt(2 / 3) * 2 / 3 = 272.2 px from
    the axis, and the corner is 734.3 px away."""
    message = (
        r"Camera.distortion: Distortion\(k1=-0.5, .*\) folds the image .* 272.2 px .* 734.3 px"
    )
    with pytest.raises(RenderError, match=message):
        Camera(1280, 720, fx=500.0, distortion=Distortion(k1=-0.5))
    Camera(384, 384, fx=500.0, distortion=Distortion(k1=-0.5))  # its corner is at 271.5 px


def test_a_coefficient_that_is_no_number_is_refused():
    with pytest.raises(RenderError, match=r"Distortion.p1: found nan, expected a number"):
        Distortion(p1=math.nan)


def test_coefficients_of_opencv_become_plain_numbers():
    """Promise: messages and files have numbers, not NumPy's scalars."""
    lens = Distortion(*np.array([[-0.2, 0.1, 0.0, 0.001, 0.0]]).ravel())
    assert repr(lens) == "Distortion(k1=-0.2, k2=0.1, p1=0.0, p2=0.001, k3=0.0)"


def test_no_lens_and_one_that_does_nothing_are_a_pinhole():
    """Promise: cameras without a lens stay equal to the bit, and compare equal."""
    pinhole, flat = Camera(**SIZE), Camera(**SIZE, distortion=Distortion())
    assert flat == pinhole
    assert flat.distortion is None
    pixels = pinhole.grid(5)
    assert np.array_equal(pinhole.undistort(pixels), pixels)
    assert np.array_equal(pinhole.distort(pixels), pixels)
    centers = pinhole.centers().reshape(360, 640, 2)
    assert np.array_equal(pinhole.undistorted_positions(), centers)
    points = np.random.default_rng(2).uniform(0.5, 1, (50, 3))
    before = (450.0, 440.0) * points[:, :2] / points[:, 2:] + (300.0, 185.0)
    assert np.array_equal(pinhole.project(points), before)
