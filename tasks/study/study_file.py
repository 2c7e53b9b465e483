"""Read a study from a TOML file: any scenes, sensors, light, speeds and methods."""

from __future__ import annotations

from dataclasses import field, fields, make_dataclass, replace
from pathlib import Path
from typing import Any

from eres_render.errors import suggestion
from eres_render.storage.settings_reader import check_known, read_toml, read_typed
from sensor import EventCamera, find_camera
from sensor.cameras.files import camera_of
from sensor.errors import SensorError
from tasks.errors import StudyError, WeightsError
from tasks.evaluation.settings import Evaluate
from tasks.registry import TASKS, load
from tasks.study import rules
from tasks.study.changes import is_path, with_weights
from tasks.study.settings import Simulate, Study

_PRESETS = Path(__file__).parent / "presets"


def preset_names() -> list[str]:
    """Return the names of the predefined studies."""
    return sorted(file.stem for file in _PRESETS.glob("*.toml"))


def preset(name: str) -> Study:
    """Return a predefined study.

    Raises
    ------
    StudyError
        The name is unknown; the message suggests the nearest one.
    """
    if name not in preset_names():
        raise StudyError(f"preset: found {name!r}; {suggestion(name, preset_names())}")
    return read_study(_PRESETS / f"{name}.toml")


def read_study(file: str | Path) -> Study:
    """Read a study.

    Tables and fields are those of `Study`. Fields that are left out have their defaults, except
    that `widths` is empty if `sensors` is given. An entry of `sensors` is the name of a camera, a
    file, or a table, see `read_camera_of`. `bus` names a camera whose bus all
    sensors get, in place of `bus_mev_s`. `[weights]` maps methods to the files with the weights of
    their networks. All paths are relative to the file.

    Raises
    ------
    StudyError
        The file is missing or not TOML, or a field is unknown, missing or wrong. The message names
        file and field.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tasks.study.study_file import read_study
    >>> _ = Path("small.toml").write_text('scenes = ["carpet"]')
    >>> study = read_study("small.toml")
    >>> study.name, study.scenes
    ('small', ('carpet',))
    """
    file = Path(file)
    table = {"name": file.stem, **read_toml(dict[str, Any], file, StudyError)}
    check_known(table, [*_names(Study), "weights"], file, StudyError)
    if isinstance(table.get("simulate"), dict):
        table["simulate"] = _simulate(table["simulate"], file)
    table["evaluate"] = _evaluate(table.get("evaluate", {}), file)
    weights, paths = (
        read_typed(dict[str, str], table.pop(name, {}), file, StudyError, name)
        for name in ("weights", "trajectories")
    )
    if isinstance(table.get("scenes"), list):
        table["scenes"] = [_placed(name, file) for name in table["scenes"]]
    if paths:
        table["trajectories"] = {
            _placed(name, file): str(file.parent / path) for name, path in paths.items()
        }
    study = read_typed(Study, table, file, StudyError)
    placed = {name: str((file.parent / path).absolute()) for name, path in weights.items()}
    try:
        rules.check_file(study)
        return with_weights(study, placed)
    except (StudyError, WeightsError) as error:
        raise type(error)(f"{file}: {error}") from None


def _names(kind: type) -> list[str]:
    return [field.name for field in fields(kind)]


def _placed(scene: Any, file: Path) -> Any:
    """Return a scene's name, or its path if it is a folder with a "/" or a Mitsuba file."""
    if not isinstance(scene, str) or not is_path(scene):
        return scene
    placed = str(file.parent / scene)
    return placed if is_path(placed) else f"./{placed}"  # pathlib drops it


def _simulate(given: dict[str, Any], file: Path) -> dict[str, Any]:
    """Return the fields of `Simulate`, with cameras and buses resolved."""
    table = dict(given)
    check_known(table, [*_names(Simulate), "bus"], file, StudyError, "simulate.")
    for name, other in _ONE_OF:
        if name in table and other in table:
            raise StudyError(f"{file}: simulate: give {name} or {other}, not both")
    if "bus" in table:
        bus = read_typed(str, table.pop("bus"), file, StudyError, "simulate.bus")
        try:
            table["bus_mev_s"] = camera_of({"bus": bus}).bus_hz / 1e6
        except SensorError as error:
            raise StudyError(f"{file}: simulate.{error}") from None
    if "sensors" not in table:
        return table
    table.setdefault("widths", [])
    place = "simulate.sensors"
    entries = read_typed(tuple[Any, ...], table["sensors"], file, StudyError, place)
    table["sensors"] = [
        read_camera_of(entry, f"{file}: {place}[{i}]", file.parent)
        for i, entry in enumerate(entries)
    ]
    return table


def read_camera_of(entry: Any, where: str, folder: str | Path) -> EventCamera:
    """Read a camera from an entry of `simulate.sensors`.

    Parameters
    ----------
    entry
        The name of a camera, a TOML file, or a table with the keys of such a file and `name`.
    where
        File and field, for errors.
    folder
        Folder that paths of files are relative to.

    Returns
    -------
    The camera, with its size for a name if it has none.

    Raises
    ------
    StudyError
        The camera is unknown or lacks a size, or a field is wrong.
    """
    try:
        if isinstance(entry, str):
            camera = find_camera(Path(folder, entry) if entry.endswith(".toml") else entry)
        elif isinstance(entry, dict):
            table = dict(entry)
            name = read_typed(str, table.pop("name", ""), Path(where), StudyError, "name")
            camera = camera_of(table, name, folder)
        else:
            raise StudyError(f"{where}: found {entry!r}, expected a name, a .toml file or a table")
        width, height = camera.size
    except SensorError as error:
        raise StudyError(f"{where}: {error}") from None
    return camera if camera.name else replace(camera, name=f"{width}x{height}")


_ONE_OF = ("cutoffs_hz", "illuminance_lux"), ("speeds", "speeds_m_s"), ("bus", "bus_mev_s")


def _evaluate(sections: Any, file: Path) -> Evaluate:
    """Read each task's section by the class of its settings."""
    kinds = {task: load(spec.settings) for task, spec in TASKS.items()}
    defaults = [(task, kind, field(default_factory=kind)) for task, kind in kinds.items()]
    table = make_dataclass("Evaluate", defaults)
    return Evaluate(**vars(read_typed(table, sections, file, StudyError, "evaluate")))
