"""What scene.toml says, table by table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from eres_render.scene.texture_recipes import TextureRecipe
from eres_render.storage.settings_reader import Vector3, formerly


@dataclass(frozen=True, slots=True)
class PlaneSettings:
    """The square that is all the camera sees: its middle, unit normal and half its width.

    A scene with depth has no such table.
    """

    point_m: Vector3
    normal: Vector3
    half_width_m: float


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The horizontal field of view, the same at every resolution."""

    fov_deg: float


@dataclass(frozen=True, slots=True)
class FacingPlanePath:
    """A random path in front of the scene's plane; see `trajectory.generators.random_path`."""

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
    """Where the camera passes, and the point that it looks at then."""

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
    """A path through given poses, from a file in TUM's format; see `path_through`."""

    kind: Literal["tum"]
    file: str
    min_clearance_m: float


@dataclass(frozen=True, slots=True)
class BakeSettings:
    """Size of the cells of every lightmap, and the samples in each of them."""

    cell_m: float = 0.1
    spp: int = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneToml:
    """What scene.toml says, field by field.

    A Mitsuba file without a scene.toml has no path of its own.
    """

    title: str
    license: str = field(metadata=formerly("licence"))
    length_unit: str
    radiance_unit: str
    plane: PlaneSettings | None = None
    camera: CameraSettings
    path: FacingPlanePath | WaypointsPath | TumPath | None
    textures: dict[str, TextureRecipe] = field(default_factory=dict)
    bake: BakeSettings = BakeSettings()
