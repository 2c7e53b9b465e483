"""Cameras of any shape and lens, with any focal lengths along x and y and principal point."""

import dataclasses
import json

import cv2
import numpy as np
import pytest

from another_process import run_python
from eres_render import (
    Camera,
    Clip,
    Distortion,
    GroundTruth,
    Renderer,
    RenderError,
    SceneError,
    SequenceError,
    ground_truth,
    load_scene,
    open_sequence,
    render_clip,
)
from eres_render.rendering.backend import select_variant
from eres_render.sequence.ground_truth import surfaces
from eres_render.storage.exr import write_luminance
from light_scenes import dots_folder, light_evenly, room_folder, tilted_pose

WIDE = Camera(128, 72, fx=130.0, fy=104.0, cx=49.5, cy=41.25)
LENS = Distortion(k1=-0.25, k2=0.08, p1=0.002, p2=-0.001, k3=0.01)
BENT = Camera(128, 72, fx=130.0, fy=104.0, cx=49.5, cy=41.25, distortion=LENS)
CLIP = Clip(0, 0.24, 0.25, 0.26)


def random_camera(seed):
    """Draw a camera with rays at most 45 degrees off its axis."""
    rng = np.random.default_rng(seed)
    width, height = map(int, rng.integers(8, 60, 2))
    (fx, fy), (cx, cy) = rng.uniform(1, 3, 2) * (width, height), rng.uniform(0, (width, height))
    return Camera(width, height, fx=fx, fy=fy, cx=cx, cy=cy)


SOME = ["wide", "lens", *map("random {}".format, range(4))]


@pytest.fixture(scope="module")
def ramps(tmp_path_factory):
    """Planes that glow by 5 + x and by 5 + y W m^-2 sr^-1 at the point (x, y, 0), within 4 m."""
    scenes = []
    for axis in (0, 1):
        folder = dots_folder(tmp_path_factory.mktemp("ramps") / "xy"[axis])
        # Texels' centers lie at -4 and 4 m, and light is linear between them; rows run along y.
        along_x = np.array([[1.0, 9.0], [1.0, 9.0]])
        write_luminance(folder / "ramp.exr", along_x if axis == 0 else along_x.T)
        xml = (folder / "scene.xml").read_text()
        glow = """<shape type="rectangle" id="ramp">
          <transform name="to_world"><scale value="8"/></transform>
          <emitter type="area"><texture type="bitmap" name="radiance">
            <string name="filename" value="ramp.exr"/><boolean name="raw" value="true"/>
          </texture></emitter></shape>
        <shape type="rectangle" id="floor"><transform name="to_world">
          <scale value="3"/><translate z="-1"/></transform></shape></scene>"""
        (folder / "scene.xml").write_text(xml[: xml.index("<shape")] + glow)
        scenes.append(load_scene(light_evenly(folder, "floor", 0.0)))
    return scenes


def opencv(camera):
    """Return OpenCV's matrix, which counts from the center of the first pixel, and coefficients."""
    K = camera.K - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    return K, np.array(dataclasses.astuple(camera.distortion or Distortion()))


def rays_of(camera, points_px):
    """Return the rays through pixels, (N, 3), by OpenCV."""
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    pinhole_px = cv2.undistortImagePoints(points_px - 0.5, *opencv(camera), arg1=until)
    pixels = np.hstack([pinhole_px.reshape(-1, 2) + 0.5, np.ones((len(points_px), 1))])
    return pixels @ np.linalg.inv(camera.K).T


def seen_m(camera, T, points_px):
    """Return where the rays through pixels meet the plane z = 0, (N, 2) m, by OpenCV."""
    rays = rays_of(camera, points_px) @ T[:3, :3].T
    return (T[:3, 3] - T[2, 3] / rays[:, 2:] * rays)[:, :2]


@pytest.fixture
def any_pixels():
    if select_variant().startswith("scalar"):
        pytest.skip("scalar variants render square pixels only")


@pytest.mark.usefixtures("any_pixels")
@pytest.mark.parametrize("integrator", ["baked", "path"])
@pytest.mark.parametrize("camera", [WIDE, BENT, *map(random_camera, range(4))], ids=SOME)
def test_every_pixel_sees_the_point_that_the_camera_matrix_says(ramps, integrator, camera):
    """Expected: light that is linear in x or y shows where each pixel looks, to 0.01 px."""
    T = tilted_pose()
    found = [
        Renderer(scene, spp=64, integrator=integrator, camera=camera).frame(T).ravel() - 5
        for scene in ramps
    ]
    pixel_m = T[2, 3] / max(camera.fx, camera.fy)
    expected = seen_m(camera, T, camera.centers())
    np.testing.assert_allclose(np.transpose(found), expected, rtol=0, atol=0.01 * pixel_m)


@pytest.mark.usefixtures("any_pixels")
@pytest.mark.parametrize("camera", [WIDE, BENT], ids=SOME[:2])
def test_repeated_pixels_are_those_of_the_frame(ramps, camera):
    renderer, T = Renderer(ramps[1], spp=64, integrator="path", camera=camera), tilted_pose()
    pixels = np.array([0, 127, 4000, 128 * 72 - 1])
    repeats, frame = renderer.repeats(T, pixels, 4), renderer.frame(T).ravel()[pixels]
    np.testing.assert_allclose(repeats, np.tile(frame, (4, 1)), rtol=1e-4)


@pytest.mark.slow
def test_a_scalar_machine_moves_the_principal_point_and_refuses_lenses_and_oblong_pixels(ramps):
    code = (
        "import sys; from eres_render import *; scene = load_scene(sys.argv[1])\n"
        "renderer = Renderer(scene, spp=64, camera=Camera(16, 9, fx=20.0, cx=5.0, cy=6.0))\n"
        "print(*renderer.frame(scene.trajectory().pose(1.0)).ravel().tolist())\n"
        "for other in ({'fy': 21.0}, {'distortion': Distortion(k1=-0.1)}):\n"
        "  try: Renderer(scene, camera=Camera(16, 9, fx=20.0, **other))\n"
        "  except RenderError as error: print(error)"
    )
    run = run_python(code, ramps[0].folder, ERES_VARIANT="scalar_rgb")
    frame, refused, refused_lens = run.stdout.splitlines()
    camera, T = Camera(16, 9, fx=20.0, cx=5.0, cy=6.0), ramps[0].trajectory().pose(1.0)
    expected = seen_m(camera, T, camera.centers())[:, 0]
    found = np.array(frame.split(), float) - 5
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.01 * T[2, 3] / camera.fx)
    assert refused.startswith("camera: scalar_rgb renders only square pixels")
    assert "fx = 20.0, fy = 21.0, " in refused
    assert "distortion = Distortion(k1=-0.1, " in refused_lens


@pytest.mark.parametrize("depth", [False, True], ids=["plane", "room"])
def test_truth_follows_surface_points_through_any_camera(small_carpet, tmp_path, depth):
    """Expected: a point at its depth lies on the surface, and its flow ends at its projection."""
    scene = load_scene(room_folder(tmp_path / "room")) if depth else small_carpet
    distance = surfaces(scene)[0]
    for camera in (WIDE, BENT, random_camera(7)):
        truth = GroundTruth(scene.trajectory(), camera, distance, scene.plane)
        width, height = camera.width, camera.height
        assert truth.camera(width) == truth.camera(width, height) == camera
        T_0, T_1 = truth.pose(1.0), truth.pose(1.02)
        z = truth.depth(1.0, width).reshape(-1, 1).astype(float)
        points = z * rays_of(camera, camera.centers()) @ T_0[:3, :3].T + T_0[:3, 3]
        if not depth:
            np.testing.assert_allclose(points[:, 2], 0, atol=1e-6)
        there = (points - T_1[:3, 3]) @ T_1[:3, :3]
        seen, _ = cv2.projectPoints(there, np.zeros(3), np.zeros(3), *opencv(camera))
        moved_px = (seen.reshape(-1, 2) + 0.5 - camera.centers()).reshape(height, width, 2)
        flow = truth.flow(1.0, 1.02, width)
        assert np.linalg.norm(moved_px, axis=2).max() > 1
        np.testing.assert_allclose(flow.flow_px, moved_px, atol=1e-3)
        assert flow.valid.mean() > 0.5


@pytest.mark.parametrize("seed", range(8))
def test_sensors_see_through_the_same_lens(small_carpet, seed):
    """Expected: the pixels of a sensor with the frames' aspect ratio divide the frames'; those of a
    different aspect ratio divide the largest centered crop."""
    rng = np.random.default_rng(seed)
    whole = random_camera(seed + 100)
    truth = GroundTruth(small_carpet.trajectory(), whole, surfaces(small_carpet)[0])
    points = [*rng.uniform(-0.3, 0.3, 2), 1.0] * rng.uniform(0.5, 2, (20, 1))
    expected = whole.project(points)
    coarse = truth.camera(max(2, whole.width // 3))
    shares = coarse.width / whole.width, coarse.height / whole.height
    np.testing.assert_allclose(coarse.project(points), expected * shares, rtol=1e-9)

    width, height = map(int, rng.integers(2, 50, 2))
    scale = max(width / whole.width, height / whole.height)
    from_middle = scale * (expected - np.array([whole.width, whole.height]) / 2)
    part = truth.camera(width, height).project(points)
    np.testing.assert_allclose(part - np.array([width, height]) / 2, from_middle, atol=1e-9)


@pytest.mark.usefixtures("any_pixels")
def test_a_sequence_keeps_its_camera(small_carpet, tmp_path):
    """Promise: a sequence on disk keeps its camera; the manifest of square ones has not changed."""
    pinhole = Camera(128, 72, fx=160.0, fy=150.0, cx=60.0)
    narrow = Camera(128, 72, fx=160.0, fy=150.0, cx=60.0, distortion=LENS)
    for name, camera in {"lens": narrow, "wide": WIDE}.items():
        renderer = Renderer(small_carpet, spp=1, integrator="path", camera=camera)
        sequence = render_clip(renderer, CLIP, tmp_path / name, 1.0)
        assert sequence.camera == camera
        assert sequence.frame(0).shape == (72, 128)
        assert ground_truth(sequence).camera(128) == camera
    square = render_clip(Renderer(small_carpet, 32, 1), CLIP, tmp_path / "square", 1.0)
    manifest = (square.folder / "manifest.json").read_text()
    assert "intrinsics" not in manifest
    assert "distortion" not in manifest

    centered = Camera(128, 72, WIDE.fov_rad)
    for name, camera in {"lens": pinhole, "wide": centered}.items():
        with pytest.raises(RenderError, match=r"found a sequence with"):
            render_clip(Renderer(small_carpet, spp=1, camera=camera), CLIP, tmp_path / name, 1.0)
    file = sequence.folder / "manifest.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"fov_rad": 1.0}))
    with pytest.raises(
        SequenceError, match=r"manifest\.json: Camera.fx: 130.0 contradicts .*117.15"
    ):
        open_sequence(sequence.folder)


def test_a_view_that_leaves_the_plane_is_refused(small_carpet):
    """Expected: 60 degrees across 36 of 64 pixels are 91 degrees along the height."""
    with pytest.raises(SceneError, match=r"path: the view reaches .* expected at most plane"):
        _ = Renderer(small_carpet, spp=1, camera=small_carpet.camera(36, 64)).trajectory


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({}, "needs fov_rad or fx"),
        ({"fov_rad": 1.0, "fx": 8.0}, r"Camera.fx: 8.0 contradicts fov_rad = 1.0 .*9\.15"),
        ({"fx": 0.0}, r"Camera.fx: found 0.0, not in \(0, inf\)"),
        ({"fx": 9.0, "fy": np.inf}, r"Camera.fy: found inf, not in \(0, inf\)"),
        ({"fx": 9.0, "cx": np.nan}, r"Camera.cx: found nan, not in \(-inf, inf\)"),
        ({"fov_rad": 3.2}, r"Camera.fov_rad: .* 3.2 rad is not in \(0, pi\)"),
    ],
)
def test_cameras_that_cannot_be_are_refused(values, message):
    with pytest.raises(RenderError, match=message):
        Camera(10, 7, **values)


@pytest.mark.parametrize("camera", [WIDE, BENT], ids=["pinhole", "lens"])
def test_cropping_the_camera_is_cropping_the_image(camera):
    """Analytic: a point is at the pixel of the whole image less the part's first one."""
    points = camera.rays(camera.grid(7)) * 2.0
    part = camera.cropped(30, 11, 41, 23)
    assert (part.width, part.height, part.fx, part.fy) == (41, 23, camera.fx, camera.fy)
    assert part.distortion == camera.distortion
    np.testing.assert_allclose(part.project(points), camera.project(points) - (30, 11), atol=1e-9)


@pytest.mark.parametrize("camera", [WIDE, BENT], ids=["pinhole", "lens"])
def test_resizing_the_camera_is_scaling_the_image(camera):
    """Analytic: pixels scale with the sides; with a given height they are those of a central crop,
    through the same lens; neither axis is stretched."""
    points = camera.rays(camera.grid(7)) * 2.0
    whole = camera.project(points)
    half = camera.resized(64)
    assert (half.width, half.height, half.distortion) == (64, 36, camera.distortion)
    np.testing.assert_allclose(half.project(points), 0.5 * whole, atol=1e-9)
    odd = camera.resized(50)  # 28.125 rows, rounded: pixels are not quite as square
    np.testing.assert_allclose(odd.project(points), whole * (50 / 128, 28 / 72), atol=1e-9)
    square = camera.resized(36, 36)  # of the central 72 columns
    expected = (camera.cropped(28, 0, 72, 72).project(points)) / 2
    np.testing.assert_allclose(square.project(points), expected, atol=1e-9)
    row = Camera(1280, 1, fx=1000.0).resized(64)  # at least one row of pixels
    assert (row.height, row.fx, round(row.fy, 9)) == (1, 50.0, 1000.0)


@pytest.mark.parametrize("camera", [WIDE, BENT], ids=["pinhole", "lens"])
def test_zooming_spreads_the_image_about_the_principal_point(camera):
    """Analytic: pixels are farther from it by that factor; the lens keeps its coefficients."""
    points = camera.rays(camera.grid(7)) * 2.0
    center = np.array([camera.cx, camera.cy])
    zoomed = camera.zoomed(1.5)
    assert (zoomed.width, zoomed.height, zoomed.distortion) == (128, 72, camera.distortion)
    expected = center + 1.5 * (camera.project(points) - center)
    np.testing.assert_allclose(zoomed.project(points), expected, atol=1e-9)
    with pytest.raises(RenderError, match=r"fx: found -130\.0"):
        camera.zoomed(-1.0)
