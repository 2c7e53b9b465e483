"""A scene: files, camera path, and the digests that name its frames and its lightmaps."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eres_render.camera import Camera, Plane
from eres_render.errors import RenderError, SceneError, TrajectoryError, reading
from eres_render.scene.objects import MovingObject, read_object
from eres_render.scene.settings import (
    FacingPlanePath,
    ObjectSettings,
    SceneToml,
    TumPath,
    WaypointsPath,
)
from eres_render.scene.xml import Film, canonical_xml
from eres_render.storage.checksums import sha256
from eres_render.storage.digest import digest
from eres_render.storage.settings_reader import Vector3
from eres_render.trajectory.generators import facing_plane, look_at, random_path, waypoint_loop
from eres_render.trajectory.spline import Trajectory, path_through
from eres_render.trajectory.tum import read_tum_from_start

BAKE_VERSION = 3  # raise it with every change of the baking code that alters a lightmap

GIVEN_CLEARANCE_M = 0.01
"""Least distance of a path of given poses from any surface: ten times the near clip, m."""

_POINTS_A_SIDE = 17  # of an image seen through a lens
_MIN_VIEWS, _RAYS_AT_ONCE = 2001, 1 << 16  # that are checked to stay on the square
_AT_REST = 1e-14  # relative rounding of the control poses of a path through equal poses


def name_and_seed(name: str) -> tuple[str, int]:
    """Return the name of a scene and the seed after its "@"; 0 for the scene as it is."""
    base, _, seed = name.rpartition("@")
    return (base, int(seed)) if base and seed.isdecimal() else (name, 0)


@dataclass(frozen=True)
class Scene:
    """A scene, read and checked.

    Parameters
    ----------
    name
        Name of the scene's folder or file.
    xml_file
        The scene in Mitsuba's own format.
    settings
        The content of scene.toml.
    source
        The argument with which `load_scene` finds the scene: the name of a packaged scene, or an
        absolute path.
    files
        All files that scene.xml names: meshes, images, included scene files.
    given_path
        A camera path; `settings` then have none.
    film
        Size of the images and samples per pixel that a Mitsuba file asks for, which `eres render`
        uses; None for other scenes.

    Examples
    --------
    >>> from eres_render import load_scene
    >>> scene = load_scene("carpet")
    >>> scene.name, scene.xml_file.name, scene.plane.normal
    ('carpet', 'scene.xml', (0.0, 0.0, 1.0))
    >>> scene.trajectory().pose(0.5).shape
    (4, 4)
    """

    name: str
    xml_file: Path
    settings: SceneToml
    source: str
    files: tuple[Path, ...]
    given_path: Trajectory | None = None
    film: Film | None = None

    @property
    def folder(self) -> Path:
        """The folder of scene.xml, to which the files that it names are relative."""
        return self.xml_file.parent

    @cached_property
    def digest(self) -> str:
        """Digest of everything that determines a frame, except the code that renders it."""
        path = self.settings.path
        if isinstance(path, TumPath):
            path = dataclasses.replace(path, file=sha256(self._tum_file))
        return digest(
            {
                "light": self.light_digest,
                "given path": self.given_path,
                "settings": dataclasses.replace(
                    self.settings, title="", license="", path=path, objects=self._hashed_objects()
                ),
                "bake version": BAKE_VERSION,
                "lightmaps": {f.name: sha256(f) for f in self.folder.glob("lightmap_*.exr")},
            }
        )

    @cached_property
    def light_digest(self) -> str:
        """Digest of what determines the light: scene.xml and its files, textures, bake, objects."""
        files = (self.xml_file, *dict.fromkeys(self.files))
        return digest(
            {
                "files": [canonical_xml(f) if f.suffix == ".xml" else sha256(f) for f in files],
                "textures": {
                    name: recipe.digest for name, recipe in self.settings.textures.items()
                },
                "bake": self.settings.bake,
                "objects": self._hashed_objects(),
            }
        )

    @property
    def plane(self) -> Plane | None:
        """The plane that fills the view of the camera, or None if the scene has depth."""
        settings = self.settings.plane
        if settings is None:
            return None
        return Plane(settings.normal, float(np.dot(settings.normal, settings.point_m)))

    def camera(self, width: int, height: int | None = None) -> Camera:
        """Return the scene's camera at a resolution.

        The horizontal field of view is the same at every width and height.

        Parameters
        ----------
        width, height
            Size of the image, px; square by default.

        Returns
        -------
        camera
            With a centered principal point.
        """
        fov_rad = math.radians(self.settings.camera.fov_deg)
        return Camera(width, width if height is None else height, fov_rad)

    def texture_files(self) -> dict[str, str]:
        """Return the texture files by parameter of scene.xml; create those that are not cached."""
        return {name: str(recipe.file()) for name, recipe in self.settings.textures.items()}

    def objects(self, t_offset_us: int, duration_s: float) -> tuple[MovingObject, ...]:
        """Return the objects that move, in the order of scene.toml, each on its path.

        Parameters
        ----------
        t_offset_us
            Offset of the clock of the camera's path; see `Trajectory`.
        duration_s
            How long the paths must last, s.

        Returns
        -------
        objects
            Empty in a still scene.

        Raises
        ------
        TrajectoryError
            If a path cannot be read or does not cover the time from 0 to `duration_s`.
        """
        return tuple(
            read_object(
                name, moving.shapes, self.folder / moving.trajectory, t_offset_us, duration_s
            )
            for name, moving in (self.settings.objects or {}).items()
        )

    def _hashed_objects(self) -> dict[str, ObjectSettings] | None:
        """Return the settings of the objects with digests in place of their files' names."""
        if self.settings.objects is None:
            return None
        return {
            name: dataclasses.replace(moving, trajectory=sha256(self.folder / moving.trajectory))
            for name, moving in self.settings.objects.items()
        }

    @property
    def has_path(self) -> bool:
        """Whether there is a camera path."""
        return self.given_path is not None or self.settings.path is not None

    @property
    def path_name(self) -> str:
        """The name of the camera path in error messages."""
        if self.given_path is not None:
            return f"{self.name}: the given path"
        if isinstance(self.settings.path, TumPath):
            return str(self._tum_file)
        return f"{self.folder / 'scene.toml'}: path"

    @property
    def duration_s(self) -> float:
        """Duration of the camera path, seconds; `trajectory` may last longer."""
        path = self.settings.path
        if path is None or isinstance(path, TumPath):
            return self._trajectory.duration_s
        return path.duration_s

    @property
    def min_clearance_m(self) -> float:
        """Least distance of the camera path from any surface, meters."""
        if self.given_path is not None:
            return GIVEN_CLEARANCE_M
        path = self.settings.path
        return 0.0 if path is None else path.min_clearance_m

    def trajectory(self, camera: Camera | None = None) -> Trajectory:
        """Return the camera path. In a planar scene its view is checked to stay on the square.

        `Renderer.trajectory` checks the distance from the surfaces of the scene.

        Parameters
        ----------
        camera
            The camera whose view is checked; the scene's square camera by default.

        Raises
        ------
        TrajectoryError
            If the path is impossible, or neither the camera nor any object moves.
        SceneError
            If the scene has no path, or a view leaves the square.
        """
        self._check_view(self.camera(2) if camera is None else camera)
        return self._trajectory

    @cached_property
    def _trajectory(self) -> Trajectory:
        trajectory = self._unchecked_trajectory()
        moved = np.ptp(trajectory.controls, axis=0).max()
        if moved <= _AT_REST * abs(trajectory.controls).max() and not self.settings.objects:
            raise TrajectoryError(
                f"{self.path_name}: the path has length 0 and no object moves; move the camera or "
                "an object"
            )
        return trajectory

    def _check_view(self, camera: Camera) -> None:
        square, plane = self.settings.plane, self.plane
        if square is None or plane is None:
            return
        if (reach_m := self._reaches_m.get(camera)) is None:
            reach_m = _reach_m(self._trajectory, self.duration_s, camera, plane, square.point_m)
            self._reaches_m[camera] = reach_m
        if reach_m > square.half_width_m:
            raise SceneError(
                f"{self.path_name}: the view reaches {reach_m:.3f} m from plane.point_m along a "
                f"side with a field of view of {math.degrees(camera.fov_rad):.4g} degrees, "
                f"expected at most plane.half_width_m = {square.half_width_m} m; bring the path "
                "nearer to the plane, or turn the camera less"
            )

    @cached_property
    def _reaches_m(self) -> dict[Camera, float]:
        """Of the cameras whose views have been checked: each job of a study asks again."""
        return {}

    def _unchecked_trajectory(self) -> Trajectory:
        if self.given_path is not None:
            return self.given_path
        path = self.settings.path
        if path is None:
            raise SceneError(
                f"{self.xml_file}: has no camera path; give poses in TUM format (--trajectory), or "
                "a Trajectory in Python"
            )
        if isinstance(path, TumPath):
            with reading(self._tum_file, "text", TrajectoryError):
                t_offset_us, t_s, poses = read_tum_from_start(self._tum_file)
                return path_through(t_s, poses, t_offset_us)
        try:
            return self._made_path(path)
        except TrajectoryError as error:  # which starts with the field
            raise TrajectoryError(f"{self.path_name}.{error}") from error

    def _made_path(self, path: FacingPlanePath | WaypointsPath) -> Trajectory:
        """Make the path of a generator."""
        if isinstance(path, WaypointsPath):
            return waypoint_loop(
                np.array([_waypoint_pose(path, k) for k in range(len(path.waypoints))]),
                duration_s=path.duration_s,
                mean_speed_mps=path.mean_speed_mps,
                sway_m=path.sway_m,
                turn_rad=_radians(path.turn_deg),
                seed=path.seed,
            )
        square, plane = self.settings.plane, self.plane
        assert square is not None  # `load_scene` sees to it
        assert plane is not None
        return random_path(
            facing_plane(plane, square.point_m, path.distance_m),
            duration_s=path.duration_s,
            mean_speed_mps=path.mean_speed_mps,
            knot_interval_s=path.knot_interval_s,
            sway=path.sway,
            turn_rad=_radians(path.turn_deg),
            seed=path.seed,
        )

    @property
    def _tum_file(self) -> Path:
        """File of the poses of a `TumPath`; its name in scene.toml is relative to the folder."""
        assert isinstance(self.settings.path, TumPath)
        return self.folder / self.settings.path.file


def _waypoint_pose(path: WaypointsPath, k: int) -> NDArray[np.float64]:
    try:
        return look_at(path.waypoints[k].position_m, path.waypoints[k].target_m, path.up)
    except TrajectoryError as error:
        raise TrajectoryError(f"waypoints[{k}].{error}") from error


def _radians(degrees: Vector3) -> Vector3:
    x, y, z = (math.radians(value) for value in degrees)
    return x, y, z


def _reach_m(
    trajectory: Trajectory, duration_s: float, camera: Camera, plane: Plane, center_m: Vector3
) -> float:
    """Return the largest distance of any view corner from the center of a square, along a side."""
    # Through a lens the image's sides are curved, and may reach farther than its corners.
    across = camera.grid(2 if camera.distortion is None else _POINTS_A_SIDE)
    rays = camera.rays(across)
    sides = facing_plane(plane, center_m, 0.0)[:3, :2]
    t_s = _view_times(trajectory, duration_s)
    reach_m = 0.0
    poses_at_once = _RAYS_AT_ONCE // len(rays)
    for k in range(0, len(t_s), poses_at_once):  # paths may have a million poses
        poses = trajectory.pose(t_s[k : k + poses_at_once])
        try:
            rays_world = rays @ np.swapaxes(poses[:, :3, :3], 1, 2)
            points = plane.intersect(poses[:, None, :3, 3], rays_world)
        except RenderError:
            return math.inf
        reach_m = max(reach_m, float(abs((points - center_m) @ sides).max()))
    return reach_m


def _view_times(trajectory: Trajectory, duration_s: float) -> NDArray[np.float64]:
    """Return times at which the view is checked: even ones, and four in each knot interval."""
    knots_s = np.unique(np.clip(trajectory.knots_s, 0.0, duration_s))
    quarters_s = knots_s[:-1, None] + np.arange(4) / 4 * np.diff(knots_s)[:, None]
    return np.union1d(np.linspace(0.0, duration_s, _MIN_VIEWS), quarters_s)
