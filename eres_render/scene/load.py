"""Find, read and check a scene: a folder of scene.xml and scene.toml, or any Mitsuba file."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Collection
from functools import partial
from pathlib import Path

from eres_render.errors import SceneError, TrajectoryError, suggestion
from eres_render.scene.objects import MAX_OBJECTS
from eres_render.scene.scene import GIVEN_CLEARANCE_M, Scene, name_and_seed
from eres_render.scene.settings import (
    CameraSettings,
    FacingPlanePath,
    SceneToml,
    TumPath,
    WaypointsPath,
)
from eres_render.scene.xml import read_scene_xml
from eres_render.storage.settings_reader import read_toml
from eres_render.trajectory.spline import Trajectory, check_finite

_NAMES_OF_MITSUBA = ("config", "filename")  # arguments of its parser, as names of textures are
_MIN_CLEARANCE_M = 0.005  # distance; the depth at the corners of a wide view is less
_GROUPS = (".", "variants", "slider")  # folders of packaged scenes; only the first are listed
_SEEDS_APART = 1000  # of the textures, and of the paths to try, of "carpet@1" and of "carpet@2"


def scene_root() -> Path:
    """Return the folder of the packaged scenes, in a checkout or an installed wheel."""
    package = Path(__file__).parents[1]
    installed = package / "_scenes"
    return installed if installed.is_dir() else package.parent / "scenes"


def _packaged(name: str) -> Path | None:
    """Return the folder of a packaged scene, variant or print; None if the name is unknown."""
    folders = (scene_root() / group / name for group in _GROUPS)
    return next((f for f in folders if name.isidentifier() and (f / "scene.toml").is_file()), None)


def list_scenes() -> list[str]:
    """Return the names of the packaged scenes.

    Examples
    --------
    >>> from eres_render import list_scenes
    >>> list_scenes()
    ['carpet', 'rocks', 'room']
    """
    return sorted(path.parent.name for path in scene_root().glob("*/scene.toml"))


def load_scene(
    name_or_path: str | Path, trajectory: str | Path | Trajectory | None = None
) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    name_or_path
        Name of a packaged scene, of its variant ("varnished_room"), or of a print in front of a
        camera on a slider ("forest", "pebbles", "split_rocks"); path of a folder with scene.xml and
        scene.toml; or path of any Mitsuba file (.xml) with exactly one camera, which gives the
        field of view. "carpet@1", "carpet@2" and so on are the scene "carpet" with other seeds of
        its textures and its path: the first path whose view stays on the scene's square.
    trajectory
        A camera path that replaces the path in scene.toml, or a file of poses T_world_cam in TUM
        format. The camera passes through each pose of the file at its time. Times count from the
        first pose, whose own time becomes `t_offset_us`; see `path_through`.

    Returns
    -------
    scene
        Mitsuba has not loaded it yet.

    Raises
    ------
    SceneError
        If the scene does not exist, a packaged scene and a folder here have the same name, a file
        of the scene is missing, or a field is missing, of the wrong type or out of range.

    Examples
    --------
    >>> from eres_render import load_scene
    >>> scene = load_scene("carpet")
    >>> scene.settings.path.mean_speed_mps, scene.duration_s
    (0.9, 10.0)
    >>> round(scene.camera(346).fx, 2)
    299.64
    >>> load_scene("carpets")
    Traceback (most recent call last):
    eres_render.errors.SceneError: no scene, folder or .xml file named 'carpets': ...
    """
    path = Path(name_or_path)
    base, seed = name_and_seed(str(name_or_path))
    if seed and not path.exists():
        scene = _reseeded(load_scene(base), seed)
    elif packaged := _packaged(str(name_or_path)):
        if (path / "scene.toml").is_file() and path.resolve() != packaged.resolve():
            raise SceneError(
                f"{name_or_path}: found a packaged scene and a folder of this name; write "
                f"./{name_or_path} for the folder"
            )
        scene = _load_folder(packaged, str(name_or_path))
    elif path.suffix == ".xml" and path.is_file():
        scene = _load_xml(path.resolve())
    elif path.is_dir():
        scene = _load_folder(path.resolve(), str(path.resolve()))
    else:
        raise SceneError(
            f"no scene, folder or .xml file named {str(name_or_path)!r}: "
            f"{suggestion(str(name_or_path), list_scenes())}"
        )
    if trajectory is None:
        return scene
    if isinstance(trajectory, Trajectory):
        check_finite("trajectory.controls", trajectory.controls)
        settings = dataclasses.replace(scene.settings, path=None)
        return dataclasses.replace(scene, settings=settings, given_path=trajectory)
    if not Path(trajectory).is_file():
        raise SceneError(f"{trajectory}: no such file, expected a camera path in TUM's format")
    tum = TumPath("tum", str(Path(trajectory).resolve()), GIVEN_CLEARANCE_M)
    return dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, path=tum))


def _load_folder(folder: Path, source: str) -> Scene:
    toml_file, xml_file = folder / "scene.toml", folder / "scene.xml"
    for needed in (toml_file, xml_file):
        if not needed.is_file():
            raise SceneError(f"{needed}: missing; a scene folder needs it")
    settings = read_toml(SceneToml, toml_file, SceneError)
    _check(settings, toml_file)
    xml = read_scene_xml(xml_file, settings.textures)
    _check_objects(settings, toml_file, xml.shape_ids)
    return Scene(folder.name, xml_file, settings, source, xml.files)


def _load_xml(file: Path) -> Scene:
    xml = read_scene_xml(file)
    fov_rad, film = xml.camera()
    settings = SceneToml(
        title=file.name,
        license="",
        length_unit="m",
        radiance_unit="W m^-2 sr^-1",
        camera=CameraSettings(math.degrees(fov_rad)),
        path=None,
    )
    return Scene(file.stem, file, settings, str(file), xml.files, film=film)


def _reseeded(scene: Scene, seed: int) -> Scene:
    """Return a scene with other seeds of its textures and its path."""
    name, source, settings = f"{scene.name}@{seed}", f"{scene.source}@{seed}", scene.settings
    if not settings.textures and not isinstance(settings.path, FacingPlanePath | WaypointsPath):
        raise SceneError(f"{source}: the scene has neither textures nor a path with a seed")
    replace, further = dataclasses.replace, _SEEDS_APART * seed
    textures = {key: replace(r, seed=r.seed + further) for key, r in settings.textures.items()}
    settings = replace(settings, textures=textures)
    scene = replace(scene, name=name, source=source, settings=settings)
    if not isinstance(path := settings.path, FacingPlanePath | WaypointsPath):
        return scene
    for k in range(_SEEDS_APART):
        other_path = replace(path, seed=path.seed + further + k)
        varied = replace(scene, settings=replace(settings, path=other_path))
        try:
            varied.trajectory()
        except (SceneError, TrajectoryError) as error:
            reason = error
        else:
            return varied
    raise SceneError(f"{source}: none of {_SEEDS_APART} paths is possible; the last one: {reason}")


def _check_value(file: Path, holds: bool, field: str, value: object, expected: str) -> None:
    if not holds:
        raise SceneError(f"{file}: {field}: found {value}, expected {expected}")


def _check(settings: SceneToml, file: Path) -> None:
    """Refuse impossible values."""
    check = partial(_check_value, file)

    def positive(table: str, values: object, *names: str) -> None:
        for name in names:
            value = getattr(values, name)
            check(value > 0, f"{table}.{name}", value, "a positive number")

    path, plane = settings.path, settings.plane
    positive("bake", settings.bake, "cell_m", "spp")
    if path is not None:
        least = f"at least {_MIN_CLEARANCE_M:g} m, as frames begin 1 mm from the camera"
        clearance_m = path.min_clearance_m
        check(clearance_m >= _MIN_CLEARANCE_M, "path.min_clearance_m", clearance_m, least)
    if isinstance(path, FacingPlanePath | WaypointsPath):
        positive("path", path, "duration_s", "mean_speed_mps")
        check(path.seed >= 0, "path.seed", path.seed, "0 or more")
    if isinstance(path, FacingPlanePath):
        positive("path", path, "distance_m", "knot_interval_s")
        other = "another kind, or a [plane] for the camera to face"
        check(plane is not None, "path.kind", repr(path.kind), other)
    elif isinstance(path, WaypointsPath):
        check(len(path.waypoints) >= 2, "path.waypoints", len(path.waypoints), "two or more")
        check(any(path.up), "path.up", path.up, "a vector that is not 0")
    elif isinstance(path, TumPath):
        is_file = (file.parent / path.file).is_file()
        check(is_file, "path.file", repr(path.file), "an existing file")
    if plane is not None:
        positive("plane", plane, "half_width_m")
        is_unit = math.isclose(math.hypot(*plane.normal), 1.0, abs_tol=1e-9)
        check(is_unit, "plane.normal", plane.normal, "a vector of length 1")
    for name, recipe in settings.textures.items():
        other = "another name, since Mitsuba's loader uses this name"
        check(name not in _NAMES_OF_MITSUBA, f"textures.{name}", repr(name), other)
        check(recipe.seed >= 0, f"textures.{name}.seed", recipe.seed, "0 or more")
    fov_deg = settings.camera.fov_deg
    check(0 < fov_deg < 180, "camera.fov_deg", fov_deg, "between 0 and 180 degrees")


def _check_objects(settings: SceneToml, file: Path, shape_ids: Collection[str]) -> None:
    """Refuse objects without shapes or a path, and shapes that are unknown or of two objects."""
    check = partial(_check_value, file)
    objects = settings.objects or {}
    check(len(objects) <= MAX_OBJECTS, "objects", len(objects), f"at most {MAX_OBJECTS}")
    uses = Counter(shape for moving in objects.values() for shape in moving.shapes)
    for name, moving in objects.items():
        field = f"objects.{name}"
        is_name = re.fullmatch(r"[\w-]+", name) is not None  # files are named after it
        check(is_name, field, repr(name), "a name of letters, digits, - and _")
        some = "ids of shapes in scene.xml, at least one"
        check(len(moving.shapes) > 0, f"{field}.shapes", "none", some)
        for shape in moving.shapes:
            hint = suggestion(shape, sorted(shape_ids))
            known = f"the id of a shape in scene.xml: {hint}"
            check(shape in shape_ids, f"{field}.shapes", repr(shape), known)
            once = "each shape in one object only"
            check(uses[shape] == 1, f"{field}.shapes", f"{shape!r} twice", once)
        poses = file.parent / moving.trajectory
        expected = f"a file; {poses} is missing"
        check(poses.is_file(), f"{field}.trajectory", repr(moving.trajectory), expected)
