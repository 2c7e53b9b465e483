"""Read a study from a TOML file: any scenes, sensors, light, speeds and methods."""

from __future__ import annotations

import math
from dataclasses import field, make_dataclass, replace
from pathlib import Path
from typing import Any

from eres_render.storage.settings_reader import FloatOrInf, read_toml, read_typed
from sensor import cutoff_in_light
from tasks.errors import StudyError
from tasks.evaluation.settings import Evaluate
from tasks.registry import TASKS, load
from tasks.study.settings import Study, with_weights


def read_study(file: Path) -> Study:
    """Read a study.

    The tables and fields are those of `Study`; a field that is left out has its default. Under
    `[simulate]`, `illuminance_lux` can replace `cutoffs_hz`: the cutoff is then proportional to the
    light. `[weights]` has the files of networks' weights, by the names of their methods. Paths of
    scenes and of weights are relative to the file.

    Raises
    ------
    StudyError
        If the file is missing or not TOML, or a field is unknown, missing or wrong. The message
        names file and field.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tasks.study.study_file import read_study
    >>> _ = Path("small.toml").write_text('scenes = ["carpet"]')
    >>> study = read_study(Path("small.toml"))
    >>> study.name, study.scenes
    ('small', ('carpet',))
    """
    table = {"name": file.stem, **read_toml(dict[str, Any], file, StudyError)}
    sensors = table.get("simulate")
    if isinstance(sensors, dict) and "illuminance_lux" in sensors:
        if "cutoffs_hz" in sensors:
            raise StudyError(f"{file}: simulate: found both cutoffs_hz and illuminance_lux")
        table["simulate"] = {**sensors, "cutoffs_hz": _cutoffs_hz(sensors, file)}
        del table["simulate"]["illuminance_lux"]
    table["evaluate"] = _evaluate(table.get("evaluate", {}), file)
    weights = read_typed(dict[str, str], table.pop("weights", {}), file, StudyError, "weights")
    study = read_typed(Study, table, file, StudyError)
    at = {name: str((file.parent / one).absolute()) for name, one in weights.items()}
    study = with_weights(study, at)
    scenes = [str(file.parent / name) if "/" in name else name for name in study.scenes]
    return replace(study, scenes=tuple(scenes))


def _evaluate(sections: Any, file: Path) -> Evaluate:
    """Read each task's section by the class of its settings."""
    kinds = {task: load(spec.settings) for task, spec in TASKS.items()}
    defaults = [(task, kind, field(default_factory=kind)) for task, kind in kinds.items()]
    table = make_dataclass("Evaluate", defaults)
    return Evaluate(**vars(read_typed(table, sections, file, StudyError, "evaluate")))


def _cutoffs_hz(sensors: dict[str, Any], file: Path) -> list[float]:
    place, kind = "simulate.illuminance_lux", tuple[FloatOrInf, ...]
    found = read_typed(kind, sensors["illuminance_lux"], file, StudyError, place)
    if not all(lux > 0 for lux in found):
        raise StudyError(f"{file}: {place}: found {found}, expected positive numbers")
    return [lux if math.isinf(lux) else cutoff_in_light(lux) for lux in found]
