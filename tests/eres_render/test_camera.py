"""The pinhole and the plane-induced homography, against explicit geometry."""

import math

import numpy as np
import pytest

from eres_render import Camera, Plane, RenderError, plane_homography
from eres_render.camera import map_pixels
from light_scenes import tilted_pose

CAMERA = Camera(1280, 1280, math.radians(60))


def test_focal_length_of_60_degrees_across_1280_pixels():
    assert pytest.approx(1108.5125, abs=1e-3) == CAMERA.focal_px
    assert CAMERA.K[0, 2] == CAMERA.K[1, 2] == 640


def test_axes_and_pixel_origin():
    """The axis meets the middle; right is +x, down is +y; the corners lie at 0 and 1280."""
    edge = math.tan(math.radians(30))
    points = [[0, 0, 2], [edge, 0, 1], [0, edge, 1], [-edge, -edge, 1]]
    expected = [[640, 640], [1280, 640], [640, 1280], [0, 0]]
    np.testing.assert_allclose(CAMERA.project(points), expected, atol=1e-9)


def test_rays_undo_projection():
    pixels = np.random.default_rng(0).uniform(0, 1280, (50, 2))
    np.testing.assert_allclose(CAMERA.project(3.7 * CAMERA.rays(pixels)), pixels, atol=1e-9)


def test_points_behind_the_camera_are_refused():
    with pytest.raises(RenderError, match="found a point with z <= 0"):
        CAMERA.project([[0, 0, -1.0]])


def test_homography_equals_intersecting_the_plane_and_projecting_again():
    """Expected: the closed form moves pixels exactly as the plane's points move in the image."""
    normal = np.array([0.1, -0.2, 1.0])
    normal /= np.linalg.norm(normal)
    plane = Plane(tuple(normal), 0.07)
    T_0 = tilted_pose()
    T_1 = tilted_pose()
    T_1[:3, 3] += 0.05, 0.08, -0.1
    T_1[:3, :3] = T_1[:3, :3] @ tilted_pose()[:3, :3].T @ np.diag([1.0, -1.0, -1.0])
    pixels = CAMERA.grid(7)

    points = plane.intersect(T_0[:3, 3], CAMERA.rays(pixels) @ T_0[:3, :3].T)
    np.testing.assert_allclose(points @ normal, 0.07, atol=1e-12)
    expected = CAMERA.project((points - T_1[:3, 3]) @ T_1[:3, :3])

    H = plane_homography(CAMERA.K, T_0, T_1, plane)
    np.testing.assert_allclose(map_pixels(H, pixels), expected, rtol=0, atol=1e-8)


def test_homography_takes_stacks_of_poses():
    T = np.stack([tilted_pose()] * 3)
    T[:, 0, 3] += [0.0, 0.1, 0.2]
    plane = Plane((0.0, 0.0, 1.0), 0.0)
    stacked = plane_homography(CAMERA.K, T[0], T, plane)
    for H, T_1 in zip(stacked, T, strict=True):
        np.testing.assert_allclose(H, plane_homography(CAMERA.K, T[0], T_1, plane))
    np.testing.assert_allclose(stacked[0] / stacked[0, 2, 2], np.eye(3), atol=1e-12)


def test_a_ray_that_misses_the_plane_is_refused():
    plane = Plane((0.0, 0.0, 1.0), 0.0)
    up = np.array([[0.0, 0.0, 1.0]])
    with pytest.raises(RenderError, match="does not run toward the plane"):
        plane.intersect(np.array([0.0, 0.0, 1.0]), up)


def test_planes_with_equal_normals_are_equal():
    """Promise: a normal from NumPy's arithmetic makes the same plane, also as a key."""
    up = (0.0, 0.0, 1.0)
    assert {Plane(np.array(up), np.float64(2.0)): 1} == {Plane(up, 2.0): 1}
    with pytest.raises(RenderError, match=r"Plane\.normal: found \(1\.0,\), expected a vector"):
        Plane((1.0,), 0.0)


def test_sizes_of_numpy_are_sizes_and_lists_are_no_lens():
    """Promise: a camera is stored as JSON and passed to Mitsuba, which take Python's integers."""
    camera = Camera(np.int64(96), np.uint16(72), 1.0)
    assert (type(camera.width), type(camera.height)) == (int, int)
    with pytest.raises(
        RenderError, match=r"^Camera\.distortion: found \[0\.1, 0, 0, 0\], expected"
    ):
        Camera(96, 72, 1.0, distortion=[0.1, 0, 0, 0])


@pytest.mark.parametrize("size", [(0, 72), (96, -1), (96.0, 72), (96.5, 72)])
def test_a_size_is_whole_pixels(size):
    """Promise: an error of ours, also if a camera of that size was made before."""
    camera = Camera(96, 72, 1.0)
    for make in (lambda: Camera(*size, 1.0), lambda: camera.resized(*size)):
        with pytest.raises(RenderError, match=r"^Camera: found .* pixels, expected whole numbers"):
            make()
