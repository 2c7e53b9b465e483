"""Small scenes in which a ball or another object moves below a camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

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


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, turn_z_rad: float = 0.0) -> np.ndarray:
    """Return the (4, 4) pose of this shift, m, and turn."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0, 0, turn_z_rad]).as_matrix()
    T[:3, 3] = x, y, z
    return T


def write_path(file: Path, t_s: Sequence[float], *poses: np.ndarray) -> None:
    """Write poses at times in TUM's format."""
    file.write_text(tum_text(np.array(t_s, float), np.array(poses)))


def folder_of(folder: Path, *parts: str, objects: str = BALL) -> Path:
    """Write a scene that a camera at rest sees from 3 m above; the ball moves at 0.4 m/s."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scene.xml").write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    (folder / "scene.toml").write_text(SETTINGS.format(objects=objects))
    above = moved(z=3.0) @ DOWN
    write_path(folder / "camera.txt", (0.0, 1.0), above, above)
    write_path(folder / "ball.txt", (-0.5, 1.5), moved(-0.4), moved(0.4))
    return folder
