"""A carpet small enough for tests, bright dots at known places, and scenes of a few parts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from eres_render import Renderer, load_scene
from eres_render.scene.load import scene_root
from eres_render.storage.exr import write_luminance
from eres_render.trajectory.generators import look_at
from eres_render.trajectory.tum import tum_text

DOTS_M = np.array(
    [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.3, 0.0], [-0.4, -0.5, 0.0], [0.35, 0.45, 0.0]]
)
DOT_HALF_WIDTH_M = 0.02


def edit_scene(folder: Path, *changes: tuple[str, str]) -> Path:
    """Copy the carpet to a folder, with pieces of its scene.toml replaced."""
    folder.mkdir(parents=True, exist_ok=True)
    source = scene_root() / "carpet"
    text = (source / "scene.toml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "scene.toml").write_text(text)
    (folder / "scene.xml").write_bytes((source / "scene.xml").read_bytes())
    return folder


def drop_textures(folder: Path) -> None:
    """Remove the texture recipes from a scene.toml."""
    toml = (folder / "scene.toml").read_text()
    start, end = toml.index("[textures.carpet"), toml.index("[bake]")
    (folder / "scene.toml").write_text(toml[:start] + "[textures]\n\n" + toml[end:])


def light_evenly(folder: Path, shape_id: str, irradiance: float) -> Path:
    """Set a shape's lightmap by hand, so that the scene needs no baking on any machine."""
    attributes = {"eresLightDigest": load_scene(folder).light_digest}
    image = np.full((4, 4), irradiance)
    write_luminance(folder / f"lightmap_{shape_id}.exr", image, attributes)
    return folder


def small_carpet_folder(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write a carpet with 512 texels per side and settings for a quick, rough lightmap."""
    return edit_scene(
        folder,
        ("size_px = 4096", "size_px = 512"),
        ("texel_m = 0.001220703125", "texel_m = 0.009765625"),
        ("cell_m = 0.078125", "cell_m = 0.3125"),
        ("spp = 16384", "spp = 256"),
        *changes,
    )


def dots_folder(folder: Path) -> Path:
    """Write a dark plane with small glowing squares at `DOTS_M`."""
    edit_scene(
        folder,
        ("cell_m = 0.078125", "cell_m = 3.0"),
        ("spp = 16384", "spp = 4"),
    )
    drop_textures(folder)
    shapes = "".join(
        f"""
        <shape type="rectangle" id="dot_{i}">
          <transform name="to_world">
            <scale value="{DOT_HALF_WIDTH_M}"/>
            <translate x="{x}" y="{y}" z="0.0001"/>
          </transform>
          <emitter type="area"><rgb name="radiance" value="1"/></emitter>
        </shape>"""
        for i, (x, y, _) in enumerate(DOTS_M)
    )
    (folder / "scene.xml").write_text(
        f"""<scene version="3.0.0">
        <shape type="rectangle" id="floor">
          <transform name="to_world"><scale value="3"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf>
        </shape>{shapes}
        </scene>"""
    )
    return folder


CAMERA = '<sensor type="perspective"><float name="fov" value="50"/></sensor>'


def write_scene(folder: Path, *parts: str) -> Path:
    """Write mine.xml, a Mitsuba file of a scene with the parts."""
    file = folder / "mine.xml"
    file.write_text(f'<scene version="3.0.0">{"".join(parts)}</scene>')
    return file


def write_poses(
    folder: Path, positions_m: Iterable[tuple[float, float, float]], t_s: Sequence[float]
) -> Path:
    """Write poses.txt: a camera at the positions and times that looks at the origin, z up."""
    poses = np.array([look_at(p, (0, 0, 0), (0, 0, 1)) for p in positions_m])
    file = folder / "poses.txt"
    file.write_text(tum_text(np.array(t_s), poses))
    return file


def log_difference(looked_up: np.ndarray, traced: np.ndarray) -> np.ndarray:
    """Return ln of radiance looked up over radiance traced, (H, W); 0 where both are black."""
    looked_up, traced = looked_up.astype(float), traced.astype(float)
    assert np.array_equal(looked_up == 0, traced == 0)
    return np.log(np.where(looked_up > 0, looked_up, 1) / np.where(traced > 0, traced, 1))


def tilted_pose() -> np.ndarray:
    """Return a (4, 4) T_world_cam about 1.5 m above the origin, turned about all three axes."""
    a, b, c = math.radians(8), math.radians(-6), math.radians(20)
    Rx = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    Ry = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    Rz = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    T = np.eye(4)
    T[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ Rz @ Ry @ Rx
    T[:3, 3] = 0.1, -0.05, 1.5
    return T


def room_folder(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write a closed box room, 4 x 4 x 3 m, with a ball (radius 0.3 m) in its middle.

    Walls face inwards. The camera circles the ball at 1 m distance. The test sets the lightmaps by
    hand, so the scene needs no baking.
    """
    folder.mkdir(parents=True, exist_ok=True)
    toml = """title = "A box with a ball"
license = "MIT"
length_unit = "m"
radiance_unit = "W m^-2 sr^-1"

[camera]
fov_deg = 60.0

[path]
kind = "waypoints"
seed = 5
duration_s = 10.0
mean_speed_mps = 1.2
min_clearance_m = 0.2
up = [0.0, 0.0, 1.0]
sway_m = [0.05, 0.05, 0.05]
turn_deg = [2.0, 2.0, 5.0]
waypoints = [
  { position_m = [1.0, 0.0, 1.5], target_m = [0.0, 0.0, 1.4] },
  { position_m = [0.0, 1.0, 1.6], target_m = [0.0, 0.0, 1.5] },
  { position_m = [-1.0, 0.0, 1.5], target_m = [0.0, 0.0, 1.6] },
  { position_m = [0.0, -1.0, 1.4], target_m = [0.0, 0.0, 1.5] },
]

[textures]

[bake]
cell_m = 1.0
spp = 16
"""
    walls = {
        "floor": '<translate z="-1"/>',
        "ceiling": '<rotate x="1" angle="180"/><translate z="2"/>',
        "west": '<rotate y="1" angle="90"/><translate x="-2"/>',
        "east": '<rotate y="1" angle="-90"/><translate x="2"/>',
        "south": '<rotate x="1" angle="-90"/><translate y="-2"/>',
        "north": '<rotate x="1" angle="90"/><translate y="2"/>',
    }
    shapes = "".join(
        f"""
        <shape type="rectangle" id="{name}">
          <transform name="to_world"><scale value="2"/>{place}<translate z="1"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="0.{i + 2}"/></bsdf>
        </shape>"""
        for i, (name, place) in enumerate(walls.items())
    )
    xml = f"""<scene version="3.0.0">{shapes}
        <shape type="sphere" id="ball">
          <point name="center" value="0 0 1.5"/><float name="radius" value="0.3"/>
          <bsdf type="diffuse"><rgb name="reflectance" value="0.9"/></bsdf>
        </shape>
        </scene>"""
    for old, new in changes:
        assert old in toml + xml
        toml, xml = toml.replace(old, new), xml.replace(old, new)
    (folder / "scene.toml").write_text(toml)
    (folder / "scene.xml").write_text(xml)
    for shape_id in (*walls, "ball"):
        light_evenly(folder, shape_id, 3.0)
    return folder


def assert_looked_up_as_traced(scene, most_rms):
    """Compare frames of looked-up light with rays for every sample, at three poses of a path."""
    renderer = Renderer(scene, 240, 16)
    full = Renderer(scene, 240, 16, integrator="baked-full")
    assert renderer.integrator == "baked"
    for pose in scene.trajectory().pose(np.linspace(0.1, 0.9, 3) * scene.duration_s):
        difference = log_difference(renderer.frame(pose), full.frame(pose))
        assert np.sqrt(np.mean(difference**2)) < most_rms
        assert np.mean(np.abs(difference) > 1e-3) < 1e-4
        assert np.any(difference != 0), "nothing was looked up"
