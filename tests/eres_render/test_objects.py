"""Moving objects: what scene.toml says, frames, frame times and ground truth."""

import cv2
import numpy as np
import OpenEXR
import pytest

from another_process import run_python
from eres_render import (
    GroundTruth,
    Renderer,
    RenderError,
    SceneError,
    TrajectoryError,
    ground_truth,
    load_scene,
    open_sequence,
    render_scene,
    write_truth,
)
from eres_render.camera import Camera
from eres_render.sequence.ground_truth import surfaces
from eres_render.trajectory.frame_times import adaptive_times, object_image_motion
from eres_render.trajectory.tum import read_tum
from moving_objects import BALL, BLACK, DOWN, FLOOR, GLOW, SPHERE, folder_of, moved, write_path


@pytest.fixture
def scene_folder(tmp_path):
    return folder_of(tmp_path / "ball", FLOOR, SPHERE)


def test_an_object_is_where_its_poses_say(scene_folder):
    (ball,) = load_scene(scene_folder).objects(0, 1.0)
    assert (ball.name, ball.shapes) == ("ball", ("ball",))
    there = ball.pose([0.0, 0.5])[:, :3, 3]
    np.testing.assert_allclose(there, [[-0.2, 0, 0], [0, 0, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('["ball"]', '["bal"]', r"scene\.toml: objects\.ball\.shapes: found 'bal', .*mean 'ball'"),
        ('["ball"]', "[]", r"objects\.ball\.shapes: found none, expected ids"),
        ('["ball"]', '["ball", "ball"]', r"found 'ball' twice, expected each shape in one object"),
        ('"ball.txt"', '"lost.txt"', r"objects\.ball\.trajectory: found 'lost\.txt', .* missing"),
        ("objects.ball", 'objects."a/b"', r"objects\.a/b: found 'a/b', expected a name"),
        ("shapes =", "shape =", r"objects\.ball\.shape: unknown"),
    ],
)
def test_wrong_settings_are_refused_by_field(scene_folder, old, new, message):
    toml = (scene_folder / "scene.toml").read_text()
    assert old in toml
    (scene_folder / "scene.toml").write_text(toml.replace(old, new))
    with pytest.raises(SceneError, match=message):
        load_scene(scene_folder)


@pytest.mark.parametrize("t_s", [(0.1, 1.5), (-0.5, 0.9)])
def test_a_path_must_cover_the_cameras(scene_folder, t_s):
    write_path(scene_folder / "ball.txt", t_s, moved(), moved(0.1))
    with pytest.raises(TrajectoryError, match=r"ball\.txt: .*object 'ball' covers"):
        load_scene(scene_folder).objects(0, 1.0)


def test_poses_on_a_clock_of_nanoseconds(scene_folder):
    """The path of the object starts and ends with the camera's, to the nanosecond."""
    times = "1305031102.175304123", "1305031103.175304877"
    for name in ("camera", "ball"):
        file = scene_folder / f"{name}.txt"
        lines = [line.split(" ", 1)[1] for line in file.read_text().splitlines()[1:]]
        file.write_text("".join(f"{t} {line}\n" for t, line in zip(times, lines, strict=True)))
    scene = load_scene(scene_folder)
    path = scene.trajectory()
    (ball,) = scene.objects(path.t_offset_us, scene.duration_s)
    ends = ball.pose([0.0, path.duration_s])
    np.testing.assert_allclose(ends[:, 0, 3], [-0.4, 0.4], atol=1e-6)


def test_an_objects_path_is_part_of_the_scenes_digest(scene_folder):
    scene = load_scene(scene_folder)
    before = scene.digest, scene.light_digest
    write_path(scene_folder / "ball.txt", (-0.5, 1.5), moved(-0.4), moved(0.5))
    after = load_scene(scene_folder)
    assert before[0] != after.digest
    assert before[1] != after.light_digest


def test_nothing_moves_is_refused(scene_folder):
    toml = (scene_folder / "scene.toml").read_text()
    assert load_scene(scene_folder).trajectory().duration_s == 1.0
    (scene_folder / "scene.toml").write_text(toml.replace(BALL.strip(), ""))
    with pytest.raises(TrajectoryError, match="the path has length 0"):
        load_scene(scene_folder).trajectory()


LAMP = f"""<shape type="rectangle" id="lamp"><transform name="to_world">
  <scale value="0.5"/><rotate x="1" angle="180"/><translate z="3.5"/></transform>
  {BLACK}{GLOW.format(20)}</shape>"""
WHITE_FLOOR = """<shape type="rectangle" id="floor">
  <transform name="to_world"><scale value="4"/></transform><bsdf type="diffuse"/></shape>"""
KINDS = {  # shapes of each kind at rest, all before the camera
    "ball": """<shape type="sphere" id="ball">{}<point name="center" value="0 0 1"/>
      <float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>""",
    "tile": """<shape type="rectangle" id="ball"><transform name="to_world"><scale value="0.3"/>
      <translate z="1"/>{}</transform><bsdf type="diffuse"/></shape>""",
    "mesh": """<shape type="cube" id="ball"><transform name="to_world">
      <scale x="0.3" y="0.2" z="0.1"/><translate z="1"/>{}</transform><bsdf type="diffuse"/></shape>
      """,
    "bent": """<shape type="obj" id="ball"><string name="filename" value="bent.obj"/>
      <transform name="to_world"><translate z="1"/>{}</transform><bsdf type="diffuse"/></shape>""",
    "light": """<shape type="disk" id="ball"><transform name="to_world"><scale value="0.2"/>
      <rotate x="1" angle="160"/><translate z="1"/>{}</transform>
      <emitter type="area"><rgb name="radiance" value="30"/></emitter></shape>""",
}
BENT_OBJ = """v -0.3 -0.3 0\nv 0.3 -0.3 0\nv 0.3 0.3 0\nv -0.3 0.3 0
vn 0.8 0 0.6\nvn 0 0 1\nf 1//1 2//2 3//2\nf 1//1 3//2 4//1\n"""  # a square shaded as if curved
THERE = '<rotate z="1" angle="40"/><translate x="0.2" y="0.1" z="0.15"/>'


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_a_scene_with_the_object_there(tmp_path, kind):
    """Shadows and light of other objects, too; and the object comes back when time goes back."""
    shape, there = KINDS[kind], THERE
    still_shape = shape.format(there)
    if kind == "ball":
        still_shape = shape.format(f'<transform name="to_world">{there}</transform>')
    parts = WHITE_FLOOR, LAMP
    for name in ("moving", "still"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "bent.obj").write_text(BENT_OBJ)
    folder = folder_of(tmp_path / "moving", *parts, shape.format(""))
    T = moved(0.2, 0.1, 0.15, np.deg2rad(40))
    write_path(folder / "ball.txt", (0.0, 1.0), moved(), T)
    still = load_scene(folder_of(tmp_path / "still", *parts, still_shape, objects=""))
    moving, pose = Renderer(load_scene(folder), 32, 16), moved(z=3.0) @ DOWN
    before = moving.frame(pose, t_s=0.0)
    there_frame = moving.frame(pose, t_s=1.0)
    expected = Renderer(still, 32, 16, integrator="path").frame(pose)
    # A ray in a thousand may take a different path, as positions are rounded differently.
    assert np.mean(~np.isclose(there_frame, expected, rtol=1e-3)) < 0.01
    assert abs(there_frame - before).max() > 0.1 * before.mean()
    np.testing.assert_allclose(moving.frame(pose, t_s=0.0), before, rtol=1e-4)


@pytest.mark.slow
def test_an_instance_stands_still_beside_an_object(tmp_path):
    """Promise: frames and depth have both: a ball from a group, and the ball that moves past it."""
    group = """<shape type="shapegroup" id="group"><shape type="sphere">
      <float name="radius" value="0.2"/><bsdf type="diffuse"/></shape></shape>
      <shape type="instance" id="other"><ref id="group"/>
      <transform name="to_world"><translate x="0.8" z="0.5"/></transform></shape>"""
    scene = load_scene(folder_of(tmp_path, FLOOR, SPHERE, group))
    depth = truth_of(scene).depth(0.5, 96)  # the ball is at x = 0
    z_m = depth.min(initial=9.0, where=np.isfinite(depth))
    assert z_m == pytest.approx(1.7, rel=1e-3)  # the top of the ball
    column = round(48 + truth_of(scene).camera(96).fx * 0.8 / 2.3)
    assert depth[48, column] == pytest.approx(2.3, abs=0.02)  # near the top of the instance
    frame = Renderer(scene, 24, 4).frame(moved(z=3.0) @ DOWN, t_s=0.5)
    assert np.isfinite(frame).all()


@pytest.mark.slow
def test_a_scalar_machine_moves_objects_too(tmp_path):
    parts = WHITE_FLOOR, LAMP, KINDS["mesh"].format("")
    folder = folder_of(tmp_path / "mesh", *parts)
    code = (
        "import sys; from eres_render import *; r = Renderer(load_scene(sys.argv[1]), 16, 64)\n"
        "print(*r.frame(r.scene.trajectory().pose(0.9), t_s=0.9).ravel().tolist())"
    )
    scalar = np.array(run_python(code, folder, ERES_VARIANT="scalar_rgb").stdout.split(), float)
    here = Renderer(load_scene(folder), 16, 64)
    frame = here.frame(here.scene.trajectory().pose(0.9), t_s=0.9).ravel()
    before = here.frame(here.scene.trajectory().pose(0.0), t_s=0.0).ravel()
    assert np.sqrt(np.mean((scalar - frame) ** 2)) < 0.05 * frame.mean()
    assert np.sqrt(np.mean((before - frame) ** 2)) > 0.1 * frame.mean()


def test_objects_need_a_time_and_path_tracing(scene_folder):
    scene = load_scene(scene_folder)
    renderer = Renderer(scene, 16, 1)
    assert renderer.integrator == "path"
    with pytest.raises(RenderError, match="t_s: found None"):
        renderer.frame(moved(z=3.0) @ DOWN)
    for integrator in ("baked", "baked-full"):
        with pytest.raises(SceneError, match=r"moving objects \(ball\).*--integrator path"):
            Renderer(scene, 16, 1, integrator=integrator)


def test_a_shape_that_cannot_move_is_named(tmp_path):
    group = f"""<shape type="shapegroup" id="group">{KINDS["tile"].format("")}</shape>
      <shape type="instance"><ref id="group"/></shape>"""
    with pytest.raises(SceneError, match=r"'ball' of object 'ball' is an instance or inside"):
        Renderer(load_scene(folder_of(tmp_path / "group", FLOOR, group)), 8, 1)


def test_an_object_that_meets_the_camera_is_refused(scene_folder):
    """Expected: the ball, of 0.3 m, is 0.1 m below the camera when its center is at 2.6 m."""
    write_path(scene_folder / "ball.txt", (0.0, 1.0), moved(), moved(z=1.8))
    with pytest.raises(TrajectoryError, match=r"at t = 0\.8\d\d s the camera .* shape 'ball'"):
        _ = Renderer(load_scene(scene_folder), 8, 1).trajectory


def test_an_object_that_has_turned_to_the_camera_is_refused(tmp_path):
    """Expected: a ball 1 m beside the axis of its turn is at the camera after half a turn."""
    folder = folder_of(tmp_path / "turned", FLOOR, SPHERE.replace('"0 0 1"', '"1 0 3"'))
    half_a_turn = moved(x=1.0, turn_z_rad=np.pi)
    write_path(folder / "ball.txt", (0.0, 1.0), half_a_turn, half_a_turn)
    with pytest.raises(TrajectoryError, match=r"at t = 0\.000 s the camera .* shape 'ball'"):
        _ = Renderer(load_scene(folder), 8, 1).trajectory


def test_the_camera_may_be_behind_an_object(tmp_path):
    """Only a camera inside an object is refused."""
    tile = KINDS["tile"].format('<rotate x="1" angle="180"/><translate z="2"/>')
    folder = folder_of(tmp_path / "tile", FLOOR, tile)
    assert Renderer(load_scene(folder), 8, 1).trajectory.duration_s == 1.0
    folder = folder_of(tmp_path / "ball", FLOOR, SPHERE.replace('"0.3"', '"1.5"'))
    write_path(folder / "ball.txt", (0.0, 1.0), moved(z=2.0), moved(z=2.1))
    with pytest.raises(TrajectoryError, match=r"inside a solid .* shape 'ball'"):
        _ = Renderer(load_scene(folder), 8, 1).trajectory


def test_frames_are_as_close_as_an_objects_motion_needs(scene_folder):
    """Expected: the top of the ball, 1.7 m below, moves by f * 0.4 m / 1.7 m a second, and a frame
    is due every half pixel of that."""
    renderer = Renderer(load_scene(scene_folder), 64, 1)
    t_s = adaptive_times(renderer.image_motion, (0.4, 0.6), 0.5)
    px_s = renderer.camera.fx * 0.4 / 1.7
    assert len(t_s) == pytest.approx(1 + 0.2 * px_s / 0.5, abs=1)
    steps_px = np.diff(t_s) * px_s
    assert steps_px.max() < 0.5 * 1.05


def test_frames_follow_the_light_of_an_object_that_is_out_of_view(scene_folder):
    """Promise: a ball behind the camera, whose shadow may fall on the floor, moves the image as if
    it moved on the floor, 3 m below; in emitted light, where it cannot, not at all."""
    write_path(scene_folder / "ball.txt", (-0.5, 1.5), moved(-0.4, z=3.5), moved(0.4, z=3.5))
    renderer = Renderer(load_scene(scene_folder), 64, 1)
    px_s = renderer.camera.fx * 0.4 / 3.0
    assert renderer.image_motion(0.4, 0.6) == pytest.approx(0.2 * px_s, rel=1e-5)
    t_s = adaptive_times(renderer.image_motion, (0.4, 0.6), 0.5)
    np.testing.assert_allclose(np.diff(t_s)[:-1], 0.5 / px_s, rtol=1e-4)
    emitted = Renderer(load_scene(scene_folder), 64, 1, integrator="emission")
    assert emitted.image_motion(0.4, 0.6) < 1e-9


def test_an_object_that_flies_through_the_view_is_not_missed():
    """A small square crosses the view of a camera at rest within 5 ms of a second."""
    camera = Camera(100, 100, fx=100.0)
    box = np.array([[-0.01, -0.01, 0.0], [0.01, 0.01, 0.0]])

    class AtRest:
        def pose(self, t_s):
            return np.broadcast_to(np.eye(4), (*np.shape(t_s), 4, 4))

    def pose(t_s):
        return moved(x=200 * (t_s - 0.5), z=1.0)

    def distance(origin, rays):
        reach = -origin[2] / rays[:, 2]
        on = np.all(abs(origin[:2] + reach[:, None] * rays[:, :2]) <= 0.01, axis=1)
        return np.where(on & (reach > 0), reach, np.inf)

    motion = object_image_motion(AtRest(), camera, pose, box, distance)
    t_s = adaptive_times(motion, (0.0, 1.0), 10.0)
    crossing = t_s[abs(t_s - 0.5) < 0.0025]
    assert len(crossing) == pytest.approx(100 / 10, abs=2)
    assert len(t_s) < 20


def test_an_object_that_the_grid_misses_is_not_missed():
    """Two small squares, 1 m apart on one object, cross the view of a camera at rest: the step is
    the limit, though no ray of the grid over their common box meets them."""
    camera = Camera(128, 128, fx=128.0)
    box = np.array([[-0.51, -0.01, 0.0], [0.51, 0.01, 0.0]])

    class AtRest:
        def pose(self, t_s):
            return np.broadcast_to(np.eye(4), (*np.shape(t_s), 4, 4))

    def distance(origin, rays):
        return np.full(len(rays), np.inf)

    motion = object_image_motion(AtRest(), camera, lambda t: moved(x=t - 0.1, z=2.0), box, distance)
    t_s = adaptive_times(motion, (0.0, 0.2), 0.5)
    assert len(t_s) == 27  # 0.2 m of 64 px
    np.testing.assert_allclose(np.diff(t_s)[:-1], 0.5 / 64, rtol=1e-6)


def truth_of(scene, width=96):
    distance, bodies = surfaces(scene, scene.objects(0, scene.duration_s))
    return GroundTruth(scene.trajectory(), scene.camera(width), distance, scene.plane, bodies)


def test_masks_are_the_silhouette_of_a_sphere_and_of_a_square(tmp_path):
    """Expected: a ray meets the ball if it passes its center within 0.3 m, the tile if it meets its
    plane inside the turned square, which hides the ball where both are met."""
    objects = BALL + BALL.replace("ball", "tile")
    tile = """<shape type="rectangle" id="tile">
      <transform name="to_world"><scale value="0.2"/></transform></shape>"""
    folder = folder_of(tmp_path / "two", FLOOR, SPHERE, tile, objects=objects)
    write_path(folder / "tile.txt", (0.0, 1.0), moved(z=2.0), moved(0.3, 0.1, 2.0, 0.7))
    truth, t_s = truth_of(load_scene(folder)), 0.8
    camera = truth.camera(96)
    origin = np.array([0, 0, 3.0])
    rays = camera.rays(camera.centers()) * (1, -1, -1)
    x = 0.8 * (t_s + 0.5) / 2 - 0.4  # the ball, from x = -0.4 m at -0.5 s to 0.4 m at 1.5 s
    along = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    to_center = np.array([x, 0, 1]) - origin
    miss_m = np.linalg.norm(np.cross(along, to_center), axis=1)
    at_tile = (origin + rays)[:, :2] - (0.3 * t_s, 0.1 * t_s)
    turn = 0.7 * t_s
    inside_m = abs(at_tile @ [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    on_tile = inside_m.max(axis=1) < 0.2
    expected = np.where(on_tile, 2, np.where(miss_m < 0.3, 1, 0))
    clear = (abs(miss_m - 0.3) > 1e-5) & (abs(inside_m.max(axis=1) - 0.2) > 1e-5)
    found = truth.instances(t_s, 96).ravel()
    assert [one.name for one in truth.objects] == ["ball", "tile"]
    assert found.dtype == np.uint8
    assert clear.mean() > 0.99
    assert min(np.bincount(expected)) > 100
    np.testing.assert_array_equal(found[clear], expected[clear])
    np.testing.assert_allclose(truth.depth(t_s, 96).ravel()[found == 2], 1.0, rtol=1e-5)


def test_dots_on_a_moving_object_move_as_the_flow_says(tmp_path):
    """A dark tile with bright dots slides, climbs and turns below a camera that moves too: the
    centroids of the dots in the frames move by the true flow, to 0.1 px."""
    dots_m = np.array([[0.0, 0.0], [0.3, 0.1], [-0.25, 0.3], [-0.1, -0.35]])
    dots = [
        f"""<shape type="rectangle" id="dot_{k}"><transform name="to_world">
          <scale value="0.015"/><translate x="{x}" y="{y}" z="0.0001"/></transform>
          {BLACK}{GLOW.format(1)}</shape>"""
        for k, (x, y) in enumerate(dots_m)
    ]
    tile = f"""<shape type="rectangle" id="ball">
      <transform name="to_world"><scale value="0.5"/></transform>{BLACK}</shape>"""
    shapes = ", ".join(f'"dot_{k}"' for k in range(4))
    objects = BALL.replace('["ball"]', f'["ball", {shapes}]')
    folder = folder_of(tmp_path / "dots", FLOOR, tile, *dots, objects=objects)
    poses = moved(-0.1, z=1.0), moved(0.2, 0.1, 1.2, 0.5)
    write_path(folder / "ball.txt", (0.0, 1.0), *poses)
    write_path(
        folder / "camera.txt",
        (0.0, 1.0),
        moved(z=3.0) @ DOWN,
        moved(-0.2, z=2.9, turn_z_rad=0.1) @ DOWN,
    )
    scene = load_scene(folder)
    renderer, truth = Renderer(scene, 256, 64), truth_of(scene)
    t_0, t_1 = 0.4, 0.48
    flow = truth.flow(t_0, t_1, 256)
    y, x = np.mgrid[:256, :256] + 0.5
    on_tile = truth.instances(t_0, 256) == 1

    def centroids(t_s):
        frame = renderer.frame(truth.pose(t_s), t_s=t_s)
        (body,) = truth.objects
        T = np.linalg.inv(truth.pose(t_s)) @ body.pose(t_s)
        at = np.column_stack([dots_m, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3]
        for px, py in truth.camera(256).project(at):
            near = np.where((abs(x - px) < 6) & (abs(y - py) < 6), frame, 0)
            yield np.array([(near * x).sum(), (near * y).sum()]) / near.sum()

    for a, b in zip(centroids(t_0), centroids(t_1), strict=True):
        column, row = a.astype(int)
        assert flow.valid[row, column]
        assert on_tile[row, column]
        np.testing.assert_allclose(b - a, flow.flow_px[row, column], atol=0.1)
        assert np.linalg.norm(b - a) > 3
    # The floor that the tile covers next is in view and hidden; nothing is both visible and hidden.
    assert not np.any(flow.valid & flow.occluded)
    assert 50 < np.sum(flow.occluded & ~on_tile) == np.sum(flow.occluded)


@pytest.mark.usefixtures("unmeasured_noise")
def test_a_sequence_names_its_objects_and_truth_is_written(tmp_path, scene_folder):
    """The clock of the object's poses is that of the camera's, which may start at any time."""
    for name in ("camera", "ball"):
        file = scene_folder / f"{name}.txt"
        first, *lines = file.read_text().splitlines()
        later = [f"{1e9 + float(t):.1f} {rest}" for t, rest in (one.split(" ", 1) for one in lines)]
        file.write_text("\n".join([first, *later]) + "\n")
    scene = load_scene(scene_folder)
    (sequence,) = render_scene(
        scene, tmp_path / "out", resolution=24, spp=1, continuous=True, duration_s=0.3
    )
    assert open_sequence(sequence.folder).manifest.objects == ("ball",)
    truth = ground_truth(sequence)
    np.testing.assert_allclose(truth.objects[0].pose(0.25)[:3, 3], [-0.1, 0, 0], atol=1e-9)
    files = write_truth(truth, tmp_path / "truth", [0.0, 0.25], 32)
    names = sorted(str(file.relative_to(tmp_path / "truth")) for file in files)
    assert names == sorted(
        ["camera.json", "poses.txt", "flow/000000.exr", "objects/001_ball.txt"]
        + [
            f"{kind}/00000{k}.{ext}"
            for kind, ext in (("depth", "exr"), ("instances", "png"))
            for k in (0, 1)
        ]
    )
    mask = cv2.imread(str(tmp_path / "truth/instances/000001.png"), cv2.IMREAD_UNCHANGED)
    assert mask.dtype == np.uint8
    np.testing.assert_array_equal(mask, truth.instances(0.25, 32))
    t_s, poses = read_tum(tmp_path / "truth/objects/001_ball.txt", 10**15)
    np.testing.assert_array_equal(t_s, [0.0, 0.25])
    np.testing.assert_allclose(poses[1], truth.objects[0].pose(0.25), atol=1e-12)
    with OpenEXR.File(str(tmp_path / "truth/flow/000000.exr")) as file:
        found = file.channels()["occluded"].pixels
    np.testing.assert_array_equal(found, truth.flow(0.0, 0.25, 32).occluded)
    again = write_truth(truth, tmp_path / "truth", [0.0], 32, overwrite=True)
    assert sorted(p for p in (tmp_path / "truth").rglob("*") if p.is_file()) == sorted(again)
    write_path(scene_folder / "ball.txt", (1e9 - 1, 1e9 + 2), moved(), moved(0.1))
    with pytest.raises(SceneError, match="has changed since"):
        ground_truth(sequence)


def test_an_object_above_a_plane_in_closed_form(tmp_path):
    """Expected: depth exactly 3 m and no flow beside the ball; frames follow the ball's motion."""
    plane = "plane = { point_m = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0], half_width_m = 4.0 }\n"
    scene = load_scene(folder_of(tmp_path / "plane", FLOOR, SPHERE, objects=plane + BALL))
    truth = truth_of(scene, 64)
    on_ball = truth.instances(0.5, 64) == 1
    flow = truth.flow(0.5, 0.6, 64)
    assert on_ball.sum() > 50
    assert np.all(truth.depth(0.5, 64)[~on_ball] == 3.0)
    np.testing.assert_allclose(flow.flow_px[~on_ball], 0, atol=1e-4)
    assert flow.flow_px[on_ball, 0].min() > 0.5
    renderer = Renderer(scene, 64, 1)
    px_s = renderer.camera.fx * 0.4 / 1.7  # of the top of the ball
    assert renderer.image_motion(0.5, 0.6) == pytest.approx(0.1 * px_s, rel=0.05)
