"""Ground truth: depth, flow and visibility against explicit geometry and against the frames."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import OpenEXR
import pytest

from eres_render import (
    Clip,
    Flow,
    GroundTruth,
    Renderer,
    RenderError,
    SceneError,
    TrajectoryError,
    ground_truth,
    load_scene,
    open_sequence,
    render_clip,
    window_times,
    write_truth,
)
from eres_render.camera import map_pixels
from eres_render.rendering.backend import select_variant
from eres_render.rendering.load import load_mi_scene
from eres_render.rendering.raycast import RayCaster
from eres_render.sequence.ground_truth import surfaces
from eres_render.sequence.ground_truth_files import write_flow_png
from eres_render.trajectory.tum import read_tum, tum_text
from light_scenes import DOTS_M, dots_folder, light_evenly, room_folder, small_carpet_folder

WIDTH = 90
SQUARE_XML = """<scene version="3.0.0">
<sensor type="perspective"><float name="fov" value="60"/></sensor>
<shape type="rectangle" id="wall"><transform name="to_world"><scale value="3"/></transform></shape>
<shape type="rectangle" id="square">
  <transform name="to_world"><scale value="0.2"/><translate z="0.5"/></transform>
</shape>
</scene>"""


def of_scene(scene):
    return GroundTruth(scene.trajectory(), scene.camera(WIDTH), surfaces(scene)[0], scene.plane)


@pytest.fixture(scope="module")
def floating_square(tmp_path_factory):
    """A square of 0.4 m, half a meter before a wall; the camera slides past, 2 m from the wall."""
    folder = tmp_path_factory.mktemp("square")
    (folder / "scene.xml").write_text(SQUARE_XML)
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
    poses[:, :3, 3] = [[-0.1, 0.0, 2.0], [0.1, 0.05, 2.0]]
    (folder / "poses.txt").write_text(tum_text(np.array([0.0, 1.0]), poses))
    return of_scene(load_scene(folder / "scene.xml", folder / "poses.txt"))


def test_a_plane_in_closed_form_and_by_rays_agree():
    """Depth to 1e-5, flow to 0.001 px; and the flow agrees with the homography."""
    select_variant()
    scene = load_scene("carpet")
    closed = of_scene(scene)
    caster = RayCaster(load_mi_scene(scene))
    by_rays = GroundTruth(
        closed.trajectory, closed.camera(WIDTH), lambda o, d: caster.cast(o, d).distance
    )
    np.testing.assert_allclose(by_rays.depth(2.0, WIDTH), closed.depth(2.0, WIDTH), rtol=1e-5)
    for t_1 in (2.05, 1.9):
        flow, other = closed.flow(2.0, t_1, WIDTH), by_rays.flow(2.0, t_1, WIDTH)
        np.testing.assert_allclose(other.flow_px, flow.flow_px, atol=1e-3)
        np.testing.assert_array_equal(other.valid, flow.valid)
        pixels = closed.camera(WIDTH).centers()
        moved = map_pixels(closed.homography(2.0, t_1, WIDTH), pixels) - pixels
        np.testing.assert_allclose(flow.flow_px.reshape(-1, 2), moved, atol=1e-4)
        assert 0.5 < flow.valid.mean() < 1


def test_depth_is_along_the_axis_not_along_the_ray(floating_square):
    """Expected: 1.5 m on the square and 2 m on the wall, out to the corners."""
    depth = floating_square.depth(0.5, WIDTH)
    assert depth.dtype == np.float32
    assert depth.shape == (WIDTH, WIDTH)
    x, y = (floating_square.camera(WIDTH).rays(floating_square.camera(WIDTH).centers()).T)[:2]
    on_square = (abs(1.5 * x) < 0.2) & (abs(0.025 - 1.5 * y) < 0.2)  # the camera is at y = 0.025
    assert on_square.sum() > 100
    np.testing.assert_allclose(depth.ravel(), np.where(on_square, 1.5, 2.0), rtol=1e-6)


@pytest.mark.parametrize(
    ("size", "middle"), [((90, 60), np.s_[15:75, :]), ((60, 90), np.s_[:, 15:75])]
)
def test_a_sensor_of_another_shape_sees_the_middle(floating_square, size, middle):
    """Promise: the truth of a crop is that of the same pixels of the whole image, wide or tall."""
    whole, part = floating_square.camera(90), floating_square.camera(*size)
    assert (part.width, part.height) == size
    assert part.focal_px == pytest.approx(whole.focal_px, rel=1e-12)
    depth = floating_square.depth(0.5, *size)
    np.testing.assert_allclose(depth, floating_square.depth(0.5, 90)[middle], rtol=1e-6)
    flow, of_whole = floating_square.flow(0.2, 0.4, *size), floating_square.flow(0.2, 0.4, 90)
    np.testing.assert_allclose(flow.flow_px, of_whole.flow_px[middle], atol=1e-4)
    assert flow.valid.mean() > 0.9
    assert not np.any(flow.valid & ~of_whole.valid[middle])


def test_flow_and_occlusion_of_a_square_before_a_wall(floating_square):
    """Expected: f (dx, dy) / depth, and invalid where the square hides the wall."""
    truth = floating_square
    camera = truth.camera(WIDTH)
    rays = camera.rays(camera.centers())
    depth = truth.depth(0.0, WIDTH).ravel()
    flow = truth.flow(0.0, 1.0, WIDTH)
    expected = camera.focal_px * np.array([-0.2, 0.05]) / depth[:, None]
    np.testing.assert_allclose(flow.flow_px.reshape(-1, 2), expected, atol=1e-4)

    seen = np.array([-0.1, 0.0, 2.0]) + depth[:, None] * rays * (1, -1, -1)
    second = np.array([0.1, 0.05, 2.0])
    share = np.where(seen[:, 2] < 0.1, 1.5 / 2.0, 0.0)  # where the way to the wall is at the square
    between = second + share[:, None] * (seen - second)
    hidden = (share > 0) & (abs(between[:, :2]).max(axis=1) < 0.2)
    there = camera.centers() + expected
    inside = np.all((there > 0) & (there < WIDTH), axis=1)
    assert hidden.sum() > 50
    np.testing.assert_array_equal(flow.valid.ravel(), inside & ~hidden)


def test_points_that_leave_the_image_are_not_seen(floating_square):
    """Promise: also where none is left; Dr.Jit ends a process that casts no rays."""
    left = np.array([[0.05, 45.0], [WIDTH - 0.05, 45.0]])
    moved_px, seen = floating_square.point_flow(left, 0.0, 1.0, WIDTH)
    inside = np.abs(left[:, 0] + moved_px[:, 0] - WIDTH / 2) < WIDTH / 2
    assert inside.tolist() == seen.tolist() == [inside[0], not inside[0]]
    (gone,) = left[~inside]
    assert not floating_square.point_flow(gone[None], 0.0, 1.0, WIDTH)[1].any()
    assert floating_square.point_flow(np.empty((0, 2)), 0.0, 1.0, WIDTH)[0].shape == (0, 2)


def test_instances_are_seen_too(tmp_path):
    """Expected: a ball of radius 0.5 about the origin, 1.5 m in front of the camera; nothing
    else."""
    (tmp_path / "scene.xml").write_text(
        """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="60"/></sensor>
        <shape type="shapegroup" id="group">
          <shape type="sphere"><float name="radius" value="0.5"/></shape>
        </shape>
        <shape type="instance"><ref id="group"/></shape></scene>"""
    )
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
    poses[:, :3, 3] = [[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]]
    (tmp_path / "poses.txt").write_text(tum_text(np.array([0.0, 1.0]), poses))
    scene = load_scene(tmp_path / "scene.xml", tmp_path / "poses.txt")
    depth = of_scene(scene).depth(0.0, 33)
    assert depth[16, 16] == pytest.approx(1.5, rel=1e-5)
    assert np.isinf(depth[0, 0])
    poses[1, 2, 3] = 0.2
    (tmp_path / "poses.txt").write_text(tum_text(np.array([0.0, 1.0]), poses))
    scene = load_scene(tmp_path / "scene.xml", tmp_path / "poses.txt")
    with pytest.raises(TrajectoryError, match="of an instance"):
        _ = Renderer(scene, 8, 1).trajectory


def test_points_at_infinity_only_turn(tmp_path):
    (tmp_path / "scene.xml").write_text(
        SQUARE_XML.replace('<scale value="3"/>', "<scale value='1e-6'/>")
    )
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
    poses[:, :3, 3] = [[-0.1, 0.0, 2.0], [0.1, 0.0, 2.0]]
    (tmp_path / "poses.txt").write_text(tum_text(np.array([0.0, 1.0]), poses))
    truth = of_scene(load_scene(tmp_path / "scene.xml", tmp_path / "poses.txt"))
    flow = truth.flow(0.0, 1.0, 32)
    assert np.isinf(truth.depth(0.0, 32)[0, 0])
    np.testing.assert_array_equal(flow.flow_px[0, 0], 0)
    assert flow.valid[0, 0]
    assert not flow.valid.all()  # the square gets before some of them


def test_bright_dots_move_as_the_flow_says(tmp_path):
    """The truth agrees with the frames: centroids of dots move by the flow, to 0.1 px."""
    scene = load_scene(light_evenly(dots_folder(tmp_path / "dots"), "floor", 0.0))
    renderer, truth = Renderer(scene, 256, 64), of_scene(scene)
    t_0, t_1 = 8.5, 8.55
    flow = truth.flow(t_0, t_1, 256)
    y, x = np.mgrid[:256, :256] + 0.5

    def projected(t):
        T = truth.pose(t)
        return truth.camera(256).project((DOTS_M - T[:3, 3]) @ T[:3, :3])

    def centroid(frame, near_px):
        near = np.where((abs(x - near_px[0]) < 9) & (abs(y - near_px[1]) < 9), frame, 0)
        return np.array([(near * x).sum(), (near * y).sum()]) / near.sum()

    before, after = (renderer.frame(truth.pose(t)) for t in (t_0, t_1))
    in_view = np.all(abs(projected(t_0) - 128) < 100, axis=1)
    assert in_view.sum() > 1
    for p_0, p_1 in zip(projected(t_0)[in_view], projected(t_1)[in_view], strict=True):
        a, b = centroid(before, p_0), centroid(after, p_1)
        assert flow.valid[int(a[1]), int(a[0])]
        np.testing.assert_allclose(b - a, flow.flow_px[int(a[1]), int(a[0])], atol=0.1)


def test_a_step_of_days_has_both_ends_of_the_window():
    """Promise: times run from the start to the end, however long the step."""
    sequence = SimpleNamespace(window_s=(0.25, 0.3))
    for step_s in (1e-300, 9.9e-7, 0.0, float("nan"), float("inf")):
        with pytest.raises(RenderError, match=r"step_s: found .* s, expected at least 1e-06"):
            window_times(sequence, step_s)
    for step_s in (0.05, 1.0, 1e6):
        assert window_times(sequence, step_s).tolist() == [0.25, 0.3]


@pytest.mark.parametrize("step_s", [0.0333333, 0.03333333, 1 / 30, 0.0333334])
def test_a_rounded_step_leaves_no_short_one(step_s):
    """Promise: a third of a tenth with few digits makes as many steps as one with many."""
    times_s = window_times(SimpleNamespace(window_s=(0.0, 0.1)), step_s)
    assert len(times_s) == 4
    assert np.diff(times_s).min() > 0.99 * step_s


def test_truth_of_a_sequence_at_any_time_and_on_disk(tmp_path, monkeypatch):
    folder = room_folder(tmp_path / "room")
    scene = load_scene(folder)
    sequence = render_clip(Renderer(scene, 32, 1), Clip(0, 0.24, 0.25, 0.29), tmp_path / "s", 1.0)
    truth = ground_truth(sequence)
    np.testing.assert_allclose(truth.pose(0.27), scene.trajectory().pose(0.27), atol=1e-14)
    with pytest.raises(SceneError, match="homography needs a planar scene"):
        truth.homography(0.25, 0.29, 32)

    for step_s in (0.01, 0.0399999999, 1.0):  # both ends, also if the last step is a hair long
        times_s = window_times(sequence, step_s)
        assert (times_s[0], times_s[-1]) == sequence.window_s

    there = []  # camera.json tells a complete folder from that of a killed writer

    def look(stage, done, total):
        there.append((tmp_path / "out" / "camera.json").exists())

    for bad in ([0.3, 0.25], [0.25, 0.25], [0.25, np.nan], 0.25, []):
        with pytest.raises(RenderError, match=r"t_s: found .*, expected one or more increasing"):
            write_truth(truth, tmp_path / "out", bad, 40)
    assert not (tmp_path / "out").exists()
    options = {"flow_png": True, "on_progress": look}
    files = write_truth(truth, tmp_path / "out", sequence.window_s, 40, **options)
    assert there == [False, False]
    assert sorted(p for p in (tmp_path / "out").rglob("*") if p.is_file()) == sorted(files)
    with OpenEXR.File(str(tmp_path / "out/depth/000001.exr")) as file:
        depth = file.channels()["Z"].pixels
    np.testing.assert_array_equal(depth, truth.depth(0.29, 40))
    assert depth.dtype == np.float32
    flow = truth.flow(0.25, 0.29, 40)
    with OpenEXR.File(str(tmp_path / "out/flow/000000.exr")) as file:
        np.testing.assert_array_equal(file.channels()["u"].pixels, flow.flow_px[..., 0])
        np.testing.assert_array_equal(file.channels()["valid"].pixels, flow.valid)
    t_s, poses = read_tum(tmp_path / "out/poses.txt")
    np.testing.assert_array_equal(t_s, sequence.window_s)
    np.testing.assert_allclose(poses[1], truth.pose(0.29), atol=1e-14)
    camera = json.loads((tmp_path / "out/camera.json").read_text())
    np.testing.assert_array_equal(camera["K"], truth.camera(40).K)

    before = {file: file.read_bytes() for file in files}
    with pytest.raises(TrajectoryError, match="the requested times are"):
        write_truth(truth, tmp_path / "out", [0.25, 1e3], 40, overwrite=True)
    assert {file: file.read_bytes() for file in files} == before, "what is refused deletes nothing"

    def unlink(file, missing_ok=False):  # killed at the second file
        if len(removed) == 1:
            raise KeyboardInterrupt
        removed.append(file.name)
        os.unlink(file)

    removed = []
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", unlink)
        with pytest.raises(KeyboardInterrupt):
            write_truth(truth, tmp_path / "out", [0.25], 40, overwrite=True)
    assert removed == ["camera.json"]

    def appears(stage, done, total):
        (tmp_path / "new/camera.json").write_text("of others")

    with pytest.raises(RenderError, match=r"camera\.json: appeared meanwhile"):
        write_truth(truth, tmp_path / "new", [0.25], 40, on_progress=appears)
    assert [file.name for file in (tmp_path / "new").rglob("*")] == ["camera.json"]

    # A changed scene gives no truth for frames of the old one.
    xml = (folder / "scene.xml").read_text()
    (folder / "scene.xml").write_text(xml.replace("0 0 1.5", "0 0 1.6"))
    with pytest.raises(SceneError, match=r"scene\.xml: has changed since .* was rendered"):
        ground_truth(sequence)


def test_flow_pngs_are_read_by_dsecs_formula(tmp_path):
    """dsec.ifi.uzh.ch: flow = (png[..., :2] - 2^15) / 128 in RGB order, valid = png[..., 2]."""
    flow_px = np.array([[[1.5, -2.25], [0.0, 100.01]], [[-255.9, 3.0], [9.0, 9.0]]], np.float32)
    valid = np.array([[True, True], [True, False]])
    write_flow_png(tmp_path / "flow.png", Flow(flow_px, valid, ~valid))
    png = cv2.imread(str(tmp_path / "flow.png"), cv2.IMREAD_UNCHANGED)
    assert png.dtype == np.uint16
    rgb = png[..., ::-1].astype(np.float64)
    read = (rgb[..., :2] - 2**15) / 128
    np.testing.assert_allclose(read[valid], flow_px[valid], atol=1 / 256)
    np.testing.assert_array_equal(rgb[..., 2], valid)
    with pytest.raises(RenderError, match="256 px or more"):
        write_flow_png(tmp_path / "wide.png", Flow(flow_px + 2.5e2, valid, ~valid))
    assert not (tmp_path / "wide.png").exists()


def test_another_plane_gives_no_truth_for_frames_of_the_old_one(tmp_path):
    """Promise: depth and flow in closed form are those of the plane that the frames show."""
    folder = light_evenly(small_carpet_folder(tmp_path / "mine"), "carpet", 1.0)
    sequence = render_clip(
        Renderer(load_scene(folder), 16, 1), Clip(0, 0.24, 0.25, 0.26), tmp_path / "s", 1.0
    )
    assert ground_truth(sequence).depth(0.25, 4).shape == (4, 4)
    toml = folder / "scene.toml"
    text = toml.read_text()
    toml.write_text(text.replace("point_m = [0.0, 0.0, 0.0]", "point_m = [0.0, 0.0, 0.5]"))
    assert toml.read_text() != text
    with pytest.raises(SceneError, match=r"scene\.toml: plane: has changed since .* was rendered"):
        ground_truth(open_sequence(sequence.folder))
    toml.write_text(text)
    for plane, says in (([], False), (None, True)):  # it had none; an older file does not say
        manifest = json.loads((sequence.folder / "manifest.json").read_text())
        manifest["plane"] = plane
        (sequence.folder / "manifest.json").write_text(json.dumps(manifest))
        if says:
            assert ground_truth(open_sequence(sequence.folder)).depth(0.25, 4).shape == (4, 4)
            args = (
                Renderer(load_scene(folder), 16, 1),
                Clip(0, 0.24, 0.25, 0.26),
                sequence.folder,
                1.0,
            )
            assert len(render_clip(*args)) == len(sequence)  # and is continued
        else:
            with pytest.raises(SceneError, match="plane: has changed"):
                ground_truth(open_sequence(sequence.folder))
