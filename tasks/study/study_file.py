"""A study of one's own, from a TOML file: any scenes, sensors, light, speeds and methods."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from eres_render.storage.settings_reader import FloatOrInf, read_toml, read_typed
from sensor import cutoff_in_light
from tasks.errors import StudyError
from tasks.study.settings import Study


def read_study(file: Path) -> Study:
    """Read a study.

    The tables and fields are those of `Study`; what is left out has its default. Under
    `[simulate]`, `illuminance_lux` may stand in place of `cutoffs_hz`: the cutoff is then in
    proportion to the light. Scenes that are paths are relative to the file.

    Raises
    ------
    StudyError
        The file is missing or not TOML, or a field is unknown, missing or of the wrong type; the
        text names file and field.
    """
    table = {"name": file.stem, **read_toml(dict[str, Any], file, StudyError)}
    sensors = table.get("simulate")
    if isinstance(sensors, dict) and "illuminance_lux" in sensors:
        if "cutoffs_hz" in sensors:
            raise StudyError(f"{file}: simulate: found both cutoffs_hz and illuminance_lux")
        table["simulate"] = {**sensors, "cutoffs_hz": _cutoffs_hz(sensors, file)}
        del table["simulate"]["illuminance_lux"]
    study = read_typed(Study, table, file, StudyError)
    beside = [str(file.parent / name) if "/" in name else name for name in study.scenes]
    return replace(study, scenes=tuple(beside))


def _cutoffs_hz(sensors: dict[str, Any], file: Path) -> list[float]:
    field, kind = "simulate.illuminance_lux", tuple[FloatOrInf, ...]
    found = read_typed(kind, sensors["illuminance_lux"], file, StudyError, field)
    if not all(lux > 0 for lux in found):
        raise StudyError(f"{file}: {field}: found {found}, expected positive numbers")
    return [lux if math.isinf(lux) else cutoff_in_light(lux) for lux in found]
