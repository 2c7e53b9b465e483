"""Frames seen through a lens: every sample bent exactly, straight edges bent, and how they move."""

import cv2
import numpy as np
import pytest

from eres_render import Camera, Distortion, GroundTruth, Renderer, SceneError, load_scene
from eres_render.rendering.backend import select_variant
from eres_render.sequence.ground_truth import surfaces
from eres_render.trajectory.frame_times import (
    depth_image_motion,
    object_image_motion,
    plane_image_motion,
)
from light_scenes import dots_folder, light_evenly, log_difference, tilted_pose

LENS = Distortion(k1=-0.3, k2=0.1, p1=0.002, p2=-0.003, k3=-0.01)
CAMERA = Camera(96, 64, fx=70.0, fy=66.0, cx=44.0, cy=35.0, distortion=LENS)


@pytest.fixture
def any_lens():
    if select_variant().startswith("scalar"):
        pytest.skip("scalar variants render pinholes only")


@pytest.fixture(scope="module")
def half_plane(tmp_path_factory):
    """The plane z = 0, which glows by 1 W m^-2 sr^-1 for x > 0.55 m and is black elsewhere."""
    folder = dots_folder(tmp_path_factory.mktemp("half"))
    (folder / "scene.xml").write_text(
        """<scene version="3.0.0"><shape type="rectangle" id="glow"><transform name="to_world">
        <scale value="5"/><translate x="5.55"/></transform>
        <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        <shape type="rectangle" id="floor"><transform name="to_world"><scale value="9"/>
        <translate z="-1"/></transform></shape></scene>"""
    )
    return load_scene(light_evenly(folder, "floor", 0.0))


def bent_by_opencv(camera, points):
    """Return where OpenCV's projectPoints shows points, px from the image's corner."""
    d = camera.distortion
    K = camera.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    terms = np.array([d.k1, d.k2, d.p1, d.p2, d.k3])
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, terms)[0].reshape(-1, 2) + 0.5


@pytest.mark.usefixtures("any_lens")
def test_a_straight_edge_is_bent_as_opencv_says(half_plane):
    """Expected: the border of light in each row of pixels lies within 0.02 px of the curve that
    cv2.projectPoints makes of the straight edge, which it bends by more than 1 px."""
    T = tilted_pose()
    frame = Renderer(half_plane, spp=1024, integrator="emission", camera=CAMERA).frame(T)
    # Not much longer than the view: OpenCV folds points far outside it into the image.
    edge = np.stack([np.full(20001, 0.55), np.linspace(-1.5, 1.5, 20001), np.zeros(20001)], axis=1)
    x, y = bent_by_opencv(CAMERA, (edge - T[:3, 3]) @ T[:3, :3]).T
    shown = (y > -1) & (y < 65)
    x, y = x[shown], y[shown]
    order = np.argsort(y)
    fine = (np.arange(64 * 50) + 0.5) / 50
    border = np.interp(fine, y[order], x[order]).reshape(64, 50).mean(axis=1)
    inside = (border > 1) & (border < 95)
    assert inside.sum() > 40
    found = 96 - frame.sum(axis=1)  # light is to the right
    np.testing.assert_allclose(found[inside], border[inside], rtol=0, atol=0.02)
    rows = np.arange(64)[inside]
    assert abs(np.polyval(np.polyfit(rows, border[inside], 1), rows) - border[inside]).max() > 1


@pytest.mark.usefixtures("any_lens")
def test_a_lens_shows_what_a_pinhole_shows_at_bent_positions(small_carpet):
    """Expected: the mean over a pixel of a fine pinhole image, read at bent positions."""
    fine = 8
    T = small_carpet.trajectory().pose(3.0)
    K = {"fx": 110.0, "fy": 104.0, "cx": 44.0, "cy": 35.0}
    camera = Camera(96, 64, **K, distortion=LENS)
    frame = Renderer(small_carpet, spp=400, camera=camera).frame(T)

    # A pinhole with pixels an eighth as large, and room for what the lens draws in.
    room = 12
    pinhole = Camera(
        fine * (96 + 2 * room),
        fine * (64 + 2 * room),
        fx=fine * camera.fx,
        fy=fine * camera.fy,
        cx=fine * (camera.cx + room),
        cy=fine * (camera.cy + room),
    )
    image = Renderer(small_carpet, spp=16, integrator="baked", camera=pinhole).frame(T)
    columns, rows = np.meshgrid(np.arange(96 * fine) + 0.5, np.arange(64 * fine) + 0.5)
    bent = camera.undistort(np.stack([columns, rows], axis=-1) / fine)
    assert bent.min() > -room + 1
    at = (fine * (bent + room) - 0.5).astype(np.float32)
    seen = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    expected = seen.reshape(64, fine, 96, fine).mean(axis=(1, 3))
    off = np.log(frame / expected)
    assert np.sqrt(np.mean(off**2)) < 0.005
    straight = Renderer(small_carpet, spp=64, camera=Camera(96, 64, **K)).frame(T)
    assert np.sqrt(np.mean(np.log(straight / expected) ** 2)) > 0.1


@pytest.mark.usefixtures("any_lens")
@pytest.mark.parametrize(
    "lens", [LENS, Distortion(k1=0.25, k2=-0.03)], ids=["barrel", "pincushion"]
)
def test_baked_light_is_looked_up_through_a_lens_as_traced(small_carpet, lens):
    """Promise: log radiance to 1e-4, also through pixels that are not square."""
    camera = Camera(240, 180, fx=170.0, fy=150.0, cx=117.0, cy=95.0, distortion=lens)
    looked_up, full = (
        Renderer(small_carpet, spp=16, integrator=one, camera=camera)
        for one in ("baked", "baked-full")
    )
    for t_s in (1.0, 3.0):
        pose = small_carpet.trajectory().pose(t_s)
        off = log_difference(looked_up.frame(pose), full.frame(pose))
        assert np.sqrt(np.mean(off**2)) < 1e-4
        assert abs(off).max() < 2e-3
        assert np.any(off != 0), "nothing was looked up"


def test_the_motion_of_the_image_is_that_of_bent_points(small_carpet):
    """Expected: on each grid, the largest way of a point between its two projections by OpenCV."""
    path, plane = small_carpet.trajectory(), small_carpet.plane
    t_0, t_1 = 2.0, 2.01
    T_0, T_1 = path.pose([t_0, t_1])

    def largest(points_px):
        points = plane.intersect(T_0[:3, 3], CAMERA.rays(points_px) @ T_0[:3, :3].T)
        there = bent_by_opencv(CAMERA, (points - T_1[:3, 3]) @ T_1[:3, :3])
        return np.linalg.norm(there - points_px, axis=1).max()

    def inverse_depth(T, points_px):
        return 1 / plane.distance(T[:3, 3], CAMERA.rays(points_px) @ T[:3, :3].T)

    of_plane = plane_image_motion(path, CAMERA, plane)(t_0, t_1)
    assert of_plane == pytest.approx(largest(CAMERA.grid(9)), rel=1e-9)
    of_depth = depth_image_motion(path, CAMERA, inverse_depth)(t_0, t_1)
    assert of_depth == pytest.approx(largest(CAMERA.grid(33)), rel=1e-9)


def test_the_motion_of_an_object_is_that_of_bent_points():
    """Expected: a square that crosses the view at rest moves by its projections' distance."""

    class AtRest:
        def pose(self, t_s):
            return np.broadcast_to(np.eye(4), (*np.shape(t_s), 4, 4))

    def pose(t_s):
        T = np.array(AtRest().pose(t_s))
        T[..., 0, 3], T[..., 2, 3] = t_s, 2.0
        return T

    def distance(origin, rays):  # to the square |x|, |y| < 0.5 at z = 0
        reach = -origin[2] / rays[:, 2]
        return np.where(np.abs(origin + reach[:, None] * rays)[:, :2].max(1) < 0.5, reach, np.inf)

    box = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 0.0]])
    motion = object_image_motion(AtRest(), CAMERA, pose, box, distance, grid_points=65)
    side = np.linspace(-0.5, 0.5, 101)
    points = np.stack([*map(np.ravel, np.meshgrid(side, side)), np.full(101**2, 2.0)], axis=1)
    moved = bent_by_opencv(CAMERA, points + np.array([0.3, 0, 0])) - bent_by_opencv(CAMERA, points)
    assert motion(0.0, 0.3) == pytest.approx(np.linalg.norm(moved, axis=1).max(), rel=2e-3)


def test_truth_has_the_lens_and_no_homography(small_carpet):
    """Promise: a sensor of any size sees through the frames' lens; no matrix maps its pixels."""
    truth = GroundTruth(
        small_carpet.trajectory(), CAMERA, surfaces(small_carpet)[0], small_carpet.plane
    )
    assert truth.camera(48).distortion == LENS
    assert truth.camera(30, 30).distortion == LENS
    with pytest.raises(SceneError, match=r"a homography needs a pinhole camera, but .* has Dist"):
        truth.homography(1.0, 1.1, 96)
