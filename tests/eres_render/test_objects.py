"""Moving objects: what scene.toml says, frames, frame times and ground truth."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from another_process import run_python
from eres_render import Renderer, RenderError, SceneError, TrajectoryError, load_scene
from eres_render.camera import Camera
from eres_render.trajectory.frame_times import adaptive_times, object_image_motion
from eres_render.trajectory.tum import tum_text

DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # a camera that looks down at the floor
SETTINGS = """title = "A ball above a floor"
license = "MIT"
length_unit = "m"
radiance_unit = "W m^-2 sr^-1"
camera = {{ fov_deg = 60.0 }}
path = {{ kind = "tum", file = "camera.txt", min_clearance_m = 0.1 }}

{objects}
"""
BALL = """
[objects.ball]
shapes = ["ball"]
trajectory = "ball.txt"
"""
GLOW = '<emitter type="area"><rgb name="radiance" value="{}"/></emitter>'
BLACK = '<bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>'
FLOOR = f"""<shape type="rectangle" id="floor">
  <transform name="to_world"><scale value="4"/></transform>{BLACK}{GLOW.format(0.2)}</shape>"""
SPHERE = f"""<shape type="sphere" id="ball">
  <point name="center" value="0 0 1"/><float name="radius" value="0.3"/>
  {BLACK}{GLOW.format(1)}</shape>"""


def moved(x=0.0, y=0.0, z=0.0, turn_z_rad=0.0):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, turn_z_rad]).as_matrix()
    T[:3, 3] = x, y, z
    return T


def write_path(file: Path, t_s, *poses) -> None:
    file.write_text(tum_text(np.array(t_s, float), np.array(poses)))


def folder_of(folder: Path, *parts: str, objects: str = BALL) -> Path:
    """Write a scene that a camera at rest sees from 3 m above; the ball moves by 0.4 m a second."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    (folder / "scene.toml").write_text(SETTINGS.format(objects=objects))
    above = moved(z=3.0) @ DOWN
    write_path(folder / "camera.txt", (0.0, 1.0), above, above)
    write_path(folder / "ball.txt", (-0.5, 1.5), moved(-0.4), moved(0.4))
    return folder


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
    with pytest.raises(TrajectoryError, match=r"ball\.txt: .*object 'ball' that covers the cam"):
        load_scene(scene_folder).objects(0, 1.0)


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
    with pytest.raises(TrajectoryError, match="expected a camera or an object that moves"):
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
    "light": """<shape type="disk" id="ball"><transform name="to_world"><scale value="0.2"/>
      <rotate x="1" angle="160"/><translate z="1"/>{}</transform>
      <emitter type="area"><rgb name="radiance" value="30"/></emitter></shape>""",
}
THERE = '<rotate z="1" angle="40"/><translate x="0.2" y="0.1" z="0.15"/>'


@pytest.mark.parametrize("kind", KINDS)
def test_frames_are_those_of_a_scene_with_the_object_there(tmp_path, kind):
    """Shadows and light of other objects, too; and the object comes back when time goes back."""
    shape, there = KINDS[kind], THERE
    still_shape = shape.format(there)
    if kind == "ball":
        still_shape = shape.format(f'<transform name="to_world">{there}</transform>')
    parts = WHITE_FLOOR, LAMP
    folder = folder_of(tmp_path / "moving", *parts, shape.format(""))
    T = moved(0.2, 0.1, 0.15, np.deg2rad(40))
    write_path(folder / "ball.txt", (0.0, 1.0), moved(), T)
    still = load_scene(folder_of(tmp_path / "still", *parts, still_shape, objects=""))
    moving, pose = Renderer(load_scene(folder), 32, 16), moved(z=3.0) @ DOWN
    before = moving.frame(pose, t_s=0.0)
    there_frame = moving.frame(pose, t_s=1.0)
    expected = Renderer(still, 32, 16, integrator="path").frame(pose)
    # A ray in a thousand may take another turn, as positions are rounded differently.
    assert np.mean(~np.isclose(there_frame, expected, rtol=1e-3)) < 0.01
    assert abs(there_frame - before).max() > 0.1 * before.mean()
    np.testing.assert_allclose(moving.frame(pose, t_s=0.0), before, rtol=1e-4)


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
    with pytest.raises(RenderError, match="found no t_s"):
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


def test_frames_are_as_close_as_an_objects_motion_needs(scene_folder):
    """Expected: the top of the ball, 1.7 m below, moves by f * 0.4 m / 1.7 m a second, and a frame
    is due every half pixel of that."""
    renderer = Renderer(load_scene(scene_folder), 64, 1)
    t_s = adaptive_times(renderer.image_motion, (0.4, 0.6), 0.5)
    px_s = renderer.camera.fx * 0.4 / 1.7
    assert len(t_s) == pytest.approx(1 + 0.2 * px_s / 0.5, abs=1)
    steps_px = np.diff(t_s) * px_s
    assert steps_px.max() < 0.5 * 1.05


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
