"""A random scene: a closed room, things in it, objects that move, and a camera path.

Everything is a mesh with a texture of the radiance that it emits, and reflects nothing. So frames
have neither shadows nor noise, and cost one ray for each sample.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera
from eres_render.interior.atlas import CELL_M, Atlas, layout
from eres_render.interior.uv_charts import Chart, moved
from eres_render.random_scenes.paint import random_painter
from eres_render.random_scenes.paths import Poses, camera_path, object_path, path_times
from eres_render.random_scenes.solids import random_solid, room
from eres_render.storage.atomic import write_bytes, write_text
from eres_render.storage.exr import MIN_WHITE, write_luminance
from eres_render.trajectory.tum import tum_text

Float64 = NDArray[np.float64]

VERSION = 3  # raise it with every change that alters the scene of a seed

MAX_LIGHT = 4.0
"""Largest radiance of a surface of reflectance 1, W m^-2 sr^-1."""

_FOV_DEG = 60.0
_STILL, _MOVING = (2, 6), (1, 4)  # number of things and objects, both ends included
_LOG_DISTANCE_M = np.log([0.6, 4.0])  # from the camera's home
_ANGULAR_RADIUS = (0.08, 0.3)  # of a thing, over its distance
_MAX_M = 0.7  # radius of a thing
_FREE_M = 0.25  # between the camera and the sphere of any thing, and between it and the walls
_CLEARANCE_M = 0.1  # `min_clearance_m` in scene.toml
_TRIES = 100  # to find room for a thing
_MIN_REFLECTANCE = 0.3  # of white in the view; the first 160 scenes of seed 0 have 0.36 or more
_LOG_LIGHT = np.log([MIN_WHITE / _MIN_REFLECTANCE, MAX_LIGHT])
_WALL_M = 2.5  # distance at which a texel of the room is as large as a pixel
_MAX_CELL_TEXELS = 20
_MAX_TEXELS = 8_000_000  # of a texture

_SHAPE = """  <shape type="ply" id={name}>
    <string name="filename" value="{file}.ply"/>
    <boolean name="face_normals" value="true"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><texture type="bitmap" name="radiance">
      <string name="filename" value="{file}.exr"/>
      <boolean name="raw" value="true"/>
      <string name="format" value="fp16"/>
      <string name="wrap_mode" value="clamp"/>
    </texture></emitter>
  </shape>
"""
_TOML = """title = {title}
license = "CC0-1.0"
length_unit = "m"
radiance_unit = "W m^-2 sr^-1"

[camera]
fov_deg = {fov_deg}

[path]
kind = "tum"
file = "camera.txt"
min_clearance_m = {clearance_m}
"""
_OBJECT = """
[objects.{name}]
shapes = ["{name}"]
trajectory = "{name}.txt"
"""


def write_random_scene(
    folder: str | Path,
    seed: int | Sequence[int],
    duration_s: float,
    width_px: int,
    baseline_m: float = 0.0,
) -> None:
    """Write a random scene into a folder, for `load_scene` and the integrator "emission".

    A closed room fills the view. It has 2 to 6 things that stand still, and 1 to 4 objects that
    move on paths of their own: boxes, panels, turned bodies and rocks, 0.6 to 4 m away. They may
    pass through each other, but nothing comes near the camera.

    Parameters
    ----------
    folder
        The folder, created if it does not exist. It gets scene.xml and scene.toml, and for each
        shape a mesh (PLY), the radiance of its surface (EXR), and its poses (TUM) if it moves.
    seed
        Seed of all randomness. The same seed gives the same bytes.
    duration_s
        How long the paths last, s.
    width_px
        Width of the frames: textures have about one texel per pixel.
    baseline_m
        Distance of a second camera on the same rig, m. Things keep clear of it too.

    Raises
    ------
    RenderError
        If the width is not at least 1 px, or a file cannot be written.
    TrajectoryError
        If the duration is not positive.
    """
    folder = Path(folder)
    rng = np.random.default_rng(seed)
    camera = Camera(width_px, width_px, np.deg2rad(_FOV_DEG))
    eye = camera_path(duration_s, rng)
    walls = np.array([-1.0, 1.0])[:, None] * rng.uniform((2.0, 2.0, 1.4), (4.0, 5.0, 2.0), (2, 3))
    free_m = _FREE_M + baseline_m
    light = float(np.exp(rng.uniform(*_LOG_LIGHT)))
    title = json.dumps(folder.name, ensure_ascii=False)  # a basic string of TOML, too
    xml, toml = [], [_TOML.format(title=title, fov_deg=_FOV_DEG, clearance_m=_CLEARANCE_M)]

    def add(name: str, charts: Sequence[Chart], distance_m: float) -> None:
        _write_shape(folder / name, charts, distance_m / camera.fx, light, rng)
        xml.append(_SHAPE.format(name=quoteattr(name), file=name))

    add("room", room(walls, random_painter(rng)), _WALL_M)
    for kind, counts in (("thing", _STILL), ("object", _MOVING)):
        moves = kind == "object"
        for k in range(1, rng.integers(*counts, endpoint=True) + 1):
            name, place = f"{kind}_{k}", _place(eye, walls, free_m, moves, rng)
            if place is None:
                continue
            path, radius_m, distance_m = place
            solid: Sequence[Chart] = random_solid(radius_m, random_painter(rng), rng)
            if moves:
                poses = tum_text(path.t_s, path.T_world, what="T_world_object")
                write_text(folder / f"{name}.txt", poses)
                toml.append(_OBJECT.format(name=name))
            else:
                solid = moved(solid, 0.0, path.T_world[0, :3, 3])
            add(name, solid, distance_m)
    write_text(folder / "camera.txt", tum_text(eye.t_s, eye.T_world))
    write_text(folder / "scene.xml", f'<scene version="3.0.0">\n{"".join(xml)}</scene>\n')
    write_text(folder / "scene.toml", "".join(toml))


def _place(
    eye: Poses, walls: Float64, free_m: float, moves: bool, rng: np.random.Generator
) -> tuple[Poses, float, float] | None:
    """Find a place in the camera's view with room for a thing; None if there is none.

    Returns the thing's path, the radius of its sphere and its distance from the camera's first
    pose, m.
    """
    duration_s = float(eye.t_s[-1])
    home = eye.T_world[0]
    tan = np.tan(np.deg2rad(_FOV_DEG) / 2)
    for _ in range(_TRIES):
        distance_m = float(np.exp(rng.uniform(*_LOG_DISTANCE_M)))
        radius_m = min(distance_m * float(rng.uniform(*_ANGULAR_RADIUS)), _MAX_M)
        ray = np.array([*rng.uniform(-tan, tan, 2), 1.0])
        center = home[:3, 3] + distance_m * home[:3, :3] @ ray
        path = object_path(center, duration_s, rng) if moves else _at_rest(center, duration_s)
        at = path.T_world[:, :3, 3]
        apart_m = np.linalg.norm(at - eye.T_world[:, :3, 3], axis=1).min()
        inside = np.all((at > walls[0] + _FREE_M) & (at < walls[1] - _FREE_M))
        if inside and apart_m > radius_m + free_m:
            return path, radius_m, distance_m
    return None


def _at_rest(center_m: Float64, duration_s: float) -> Poses:
    t_s = path_times(duration_s)
    T = np.tile(np.eye(4), (len(t_s), 1, 1))
    T[:, :3, 3] = center_m
    return Poses(t_s, T)


def _write_shape(
    stem: Path, charts: Sequence[Chart], texel_m: float, light: float, rng: np.random.Generator
) -> None:
    """Write a mesh and its radiance."""
    area_m2 = sum(width * height for width, height in (chart.size_m for chart in charts))
    atlas: Atlas = layout(charts, round(np.sqrt(area_m2) / CELL_M))
    most = np.sqrt(_MAX_TEXELS / (atlas.rows * atlas.columns))
    texels_per_cell = int(np.clip(CELL_M / texel_m, 1, min(most, _MAX_CELL_TEXELS)))
    write_bytes(stem.with_suffix(".ply"), atlas.ply())
    reflectance = atlas.paint(texels_per_cell, int(rng.integers(1 << 32)))
    write_luminance(stem.with_suffix(".exr"), light * reflectance)
