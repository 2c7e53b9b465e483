"""Moving objects: what scene.toml says, frames, frame times and ground truth."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eres_render import SceneError, TrajectoryError, load_scene
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
