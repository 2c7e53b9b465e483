"""The content of scene.toml, table by table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from eres_render.scene.texture_recipes import TextureRecipe
from eres_render.storage.settings_reader import Vector3, formerly


@dataclass(frozen=True, slots=True)
class PlaneSettings:
    """The square about `point_m` that fills the camera's view; a scene with depth has none."""

    point_m: Vector3
    normal: Vector3
    half_width_m: float


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The horizontal field of view, the same at every resolution."""

    fov_deg: float


@dataclass(frozen=True, slots=True)
class FacingPlanePath:
    """A random path in front of the plane; see `trajectory.generators.random_path`."""

    kind: Literal["facing_plane"]
    seed: int
    duration_s: float
    mean_speed_mps: float
    min_clearance_m: float
    distance_m: float
    knot_interval_s: float
    sway: Vector3
    turn_deg: Vector3


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A position of the camera, and the point that it looks at from there."""

    position_m: Vector3
    target_m: Vector3


@dataclass(frozen=True, slots=True)
class WaypointsPath:
    """A random closed path through waypoints; see `trajectory.generators.waypoint_loop`."""

    kind: Literal["waypoints"]
    seed: int
    duration_s: float
    mean_speed_mps: float
    min_clearance_m: float
    up: Vector3
    sway_m: Vector3
    turn_deg: Vector3
    waypoints: tuple[Waypoint, ...]


@dataclass(frozen=True, slots=True)
class TumPath:
    """A path through poses from a file in TUM format; see `path_through`."""

    kind: Literal["tum"]
    file: str
    min_clearance_m: float


@dataclass(frozen=True, slots=True)
class ObjectSettings:
    """Shapes of scene.xml that move together; a file of poses T_world_object in TUM format."""

    shapes: tuple[str, ...]
    trajectory: str


@dataclass(frozen=True, slots=True)
class BakeSettings:
    """Size of the lightmap cells, and the number of samples in each cell."""

    cell_m: float = 0.1
    spp: int = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneToml:
    """The content of scene.toml; `path` is None for a Mitsuba file without it."""

    title: str
    license: str = field(metadata=formerly("licence"))
    length_unit: Literal["m"]
    radiance_unit: Literal["W m^-2 sr^-1"]
    plane: PlaneSettings | None = None
    camera: CameraSettings
    path: FacingPlanePath | WaypointsPath | TumPath | None
    textures: dict[str, TextureRecipe] = field(default_factory=dict)
    bake: BakeSettings = BakeSettings()
    objects: dict[str, ObjectSettings] | None = None
