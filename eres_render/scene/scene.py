"""Find, read and check a scene: a folder of scene.xml and scene.toml, or any Mitsuba file."""

from __future__ import annotations

import dataclasses
import difflib
import hashlib
import math
import tomllib
import typing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from eres_render.camera import Camera, Plane
from eres_render.errors import RenderError, SceneError, TrajectoryError
from eres_render.scene.settings import (
    CameraSettings,
    FacingPlanePath,
    SceneToml,
    TumPath,
    WaypointsPath,
)
from eres_render.scene.xml import read_scene_xml
from eres_render.storage.settings_reader import Vector3, read_typed
from eres_render.trajectory.generators import facing_plane, look_at, random_path, waypoint_loop
from eres_render.trajectory.spline import Trajectory, path_through
from eres_render.trajectory.tum import read_tum_from_start

BAKE_VERSION = 3  # counts every change of the baking code that alters a lightmap

_TUM_CLEARANCE_M = 0.01  # of a path that was given as poses, ten times what the camera can see


@dataclass(frozen=True)
class Scene:
    """A scene that was read and checked.

    Parameters
    ----------
    xml_file
        The scene in Mitsuba's own format.
    source
        What `load_scene` finds it by: the name of a packaged scene, else an absolute path.
    files
        All that scene.xml names: meshes, images, included files.
    """

    name: str
    xml_file: Path
    settings: SceneToml
    source: str
    files: tuple[Path, ...]

    @property
    def folder(self) -> Path:
        """Where scene.xml lies; files that it names are found from there."""
        return self.xml_file.parent

    @cached_property
    def digest(self) -> str:
        """SHA-256 over all that decides what a frame shows, except the code that renders it."""
        path = self.settings.path
        moves = self._tum_file.read_bytes() if isinstance(path, TumPath) else repr(path).encode()
        rest = dataclasses.replace(self.settings, path=None)
        lightmaps = (file.read_bytes() for file in sorted(self.folder.glob("lightmap_*.exr")))
        return _digest(
            self.light_digest.encode(),
            repr(rest).encode(),
            moves,
            str(BAKE_VERSION).encode(),
            *lightmaps,
        )

    @cached_property
    def light_digest(self) -> str:
        """SHA-256 over what a lightmap depends on: scene.xml and its files, textures, settings."""
        recipes = {name: recipe.digest for name, recipe in self.settings.textures.items()}
        return _digest(
            self.xml_file.read_bytes(),
            repr(recipes).encode(),
            repr(self.settings.bake).encode(),
            *(file.read_bytes() for file in sorted(set(self.files))),
        )

    @property
    def plane(self) -> Plane | None:
        """The plane that is all the camera ever sees, or None if the scene has depth."""
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
        """Return the scene.xml parameters that name texture files; makes those not cached."""
        return {name: str(recipe.file()) for name, recipe in self.settings.textures.items()}

    @property
    def path_name(self) -> str:
        """What to call the camera path in an error."""
        if isinstance(self.settings.path, TumPath):
            return str(self._tum_file)
        return f"{self.folder / 'scene.toml'}: path"

    @property
    def duration_s(self) -> float:
        """How long the camera path lasts."""
        path = self.settings.path
        if path is None or isinstance(path, TumPath):
            return self.trajectory().duration_s
        return path.duration_s

    @property
    def min_clearance_m(self) -> float:
        """How near the camera path may come to a surface."""
        path = self.settings.path
        return 0.0 if path is None else path.min_clearance_m

    def trajectory(self, camera: Camera | None = None) -> Trajectory:
        """Return the camera path; in a planar scene, the view stays on its square at all times.

        Whether the path keeps clear of what stands in the scene, `Renderer.trajectory` checks.

        Parameters
        ----------
        camera
            Its view is checked too, in addition to that of the scene's square camera.

        Raises
        ------
        TrajectoryError
            If there is no such path, or a camera that never moves.
        SceneError
            If the scene has no path, or a view would leave the square.
        """
        if camera is not None:
            self._check_view(self._trajectory, camera)
        return self._trajectory

    @cached_property
    def _trajectory(self) -> Trajectory:
        trajectory = self._unchecked_trajectory()
        if np.ptp(trajectory.controls, axis=0).max() == 0:
            raise TrajectoryError(
                f"{self.path_name}: found a path of length 0, expected a camera that moves"
            )
        self._check_view(trajectory, self.camera(2))
        return trajectory

    def _check_view(self, trajectory: Trajectory, camera: Camera) -> None:
        square, plane = self.settings.plane, self.plane
        if square is None or plane is None:
            return
        reach_m = _reach_m(trajectory, camera, plane, square.point_m)
        if reach_m > square.half_width_m:
            raise SceneError(
                f"{self.path_name}: the view reaches {reach_m:.3f} m from "
                f"plane.point_m along a side, expected at most plane.half_width_m = "
                f"{square.half_width_m} m; bring the path nearer to the plane, or turn less"
            )

    def _unchecked_trajectory(self) -> Trajectory:
        path, square, plane = self.settings.path, self.settings.plane, self.plane
        if isinstance(path, TumPath):
            t_offset_us, t_s, poses = read_tum_from_start(self._tum_file)
            try:
                return path_through(t_s, poses, t_offset_us)
            except TrajectoryError as error:
                raise TrajectoryError(f"{self._tum_file}: {error}") from error
        if isinstance(path, WaypointsPath):
            return waypoint_loop(
                np.array([look_at(w.position_m, w.target_m, path.up) for w in path.waypoints]),
                duration_s=path.duration_s,
                mean_speed_mps=path.mean_speed_mps,
                sway_m=path.sway_m,
                turn_rad=_radians(path.turn_deg),
                seed=path.seed,
            )
        if path is None or square is None or plane is None:
            raise SceneError(
                f"{self.xml_file}: has no camera path; give poses in TUM's format with it "
                "(--trajectory)"
            )
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
        """The poses of a `TumPath`; in scene.toml its name is relative to the folder."""
        assert isinstance(self.settings.path, TumPath)
        return self.folder / self.settings.path.file


def _radians(degrees: Vector3) -> Vector3:
    x, y, z = (math.radians(value) for value in degrees)
    return x, y, z


def _reach_m(trajectory: Trajectory, camera: Camera, plane: Plane, middle_m: Vector3) -> float:
    """Return how far from a square's middle, along its sides, a view's corner ever lands."""
    poses = trajectory.pose(np.linspace(0.0, trajectory.duration_s, 2001))
    corner_rays = camera.rays(camera.grid(2)) @ np.swapaxes(poses[:, :3, :3], 1, 2)
    try:
        seen = plane.intersect(poses[:, None, :3, 3], corner_rays)
    except RenderError:
        return math.inf
    sides = facing_plane(plane, middle_m, 0.0)[:3, :2]
    return float(abs((seen - middle_m) @ sides).max())


def scene_root() -> Path:
    """Return the folder of the packaged scenes, in a checkout or in an installed wheel."""
    package = Path(__file__).parents[1]
    installed = package / "_scenes"
    return installed if installed.is_dir() else package.parent / "scenes"


def list_scenes() -> list[str]:
    """Return the names of the packaged scenes."""
    return sorted(path.parent.name for path in scene_root().glob("*/scene.toml"))


def load_scene(name_or_path: str | Path, trajectory_file: str | Path | None = None) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name_or_path
        Name of a packaged scene, path of a folder with a scene.xml and a scene.toml, or path of any
        Mitsuba file (.xml) with exactly one camera, which gives the field of view.
    trajectory_file
        Poses T_world_cam in TUM's format, in place of the scene's own path. The camera passes
        through each at its time, counted from the first, whose own time the path keeps as
        `t_offset_us`; see `path_through`.

    Returns
    -------
    scene
        The scene, read and checked.

    Raises
    ------
    SceneError
        If there is no such scene, a file that it names is missing, or a field of it is missing,
        mistyped or out of range.
    """
    path = Path(name_or_path)
    if str(name_or_path) in list_scenes():
        scene = _load_folder(scene_root() / name_or_path, str(name_or_path))
    elif path.suffix == ".xml" and path.is_file():
        scene = _load_xml(path.resolve())
    elif path.is_dir():
        scene = _load_folder(path.resolve(), str(path.resolve()))
    else:
        near = difflib.get_close_matches(str(name_or_path), list_scenes(), n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(list_scenes())}"
        raise SceneError(
            f"no scene, no folder and no .xml file named {str(name_or_path)!r}: {hint}"
        )
    if trajectory_file is None:
        return scene
    tum = TumPath("tum", str(Path(trajectory_file).resolve()), _TUM_CLEARANCE_M)
    return dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, path=tum))


def _load_folder(folder: Path, source: str) -> Scene:
    toml_file, xml_file = folder / "scene.toml", folder / "scene.xml"
    for needed in (toml_file, xml_file):
        if not needed.is_file():
            raise SceneError(f"{needed}: missing, expected a scene folder with it")
    try:
        table = tomllib.loads(toml_file.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SceneError(f"{toml_file}: not a TOML file: {error}") from error
    settings = read_typed(SceneToml, table, toml_file, SceneError)
    _check(settings, toml_file)
    files = read_scene_xml(xml_file, settings.textures).files
    return Scene(folder.name, xml_file, settings, source, files)


def _load_xml(file: Path) -> Scene:
    xml = read_scene_xml(file)
    settings = SceneToml(
        title=file.name,
        licence="",
        length_unit="m",
        radiance_unit="W m^-2 sr^-1",
        camera=CameraSettings(math.degrees(xml.fov_rad())),
        path=None,
    )
    return Scene(file.stem, file, settings, str(file), xml.files)


def _check(settings: SceneToml, file: Path) -> None:
    """Refuse values that no scene can have."""

    def refuse(field: str, found: object, expected: str) -> typing.NoReturn:
        raise SceneError(f"{file}: {field}: found {found}, expected {expected}")

    path, plane, bake = settings.path, settings.plane, settings.bake
    positive: dict[str, float] = {"bake.cell_m": bake.cell_m, "bake.spp": bake.spp}
    if path is not None:
        positive["path.min_clearance_m"] = path.min_clearance_m
    if isinstance(path, FacingPlanePath | WaypointsPath):
        positive["path.duration_s"] = path.duration_s
        positive["path.mean_speed_mps"] = path.mean_speed_mps
    if isinstance(path, FacingPlanePath):
        positive["path.distance_m"] = path.distance_m
        positive["path.knot_interval_s"] = path.knot_interval_s
        if plane is None:
            refuse("path.kind", repr(path.kind), "another, or a [plane] for the camera to face")
    if isinstance(path, WaypointsPath) and len(path.waypoints) < 2:
        refuse("path.waypoints", len(path.waypoints), "two or more")
    if plane is not None:
        positive["plane.half_width_m"] = plane.half_width_m
        if not math.isclose(math.hypot(*plane.normal), 1.0, abs_tol=1e-9):
            refuse("plane.normal", plane.normal, "a vector of length 1")
    for field, value in positive.items():
        if not value > 0:
            refuse(field, value, "a positive number")
    if not 0 < settings.camera.fov_deg < 180:
        refuse("camera.fov_deg", settings.camera.fov_deg, "(0, 180) degrees")


def _digest(*parts: bytes) -> str:
    total = hashlib.sha256()
    for part in parts:
        total.update(hashlib.sha256(part).digest())
    return total.hexdigest()
