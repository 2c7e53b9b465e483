"""A study of one's own, from a TOML file: any scenes, sensors, light, speeds and methods."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

from eres_render.storage.settings_reader import read_typed
from sensor import cutoff_in_light
from tasks.errors import StudyError
from tasks.study.config import Study


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
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError(f"{file}: no such file") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StudyError(f"{file}: not TOML: {error}") from None
    sensors = table.get("simulate", {})
    cutoffs_hz = _cutoffs_hz(sensors, file) if isinstance(sensors, dict) else None
    study = read_typed(Study, {"name": file.stem, **table}, file, StudyError)
    if cutoffs_hz is not None:
        study = replace(study, simulate=replace(study.simulate, cutoffs_hz=cutoffs_hz))
    beside = [str(file.parent / name) if "/" in name else name for name in study.scenes]
    return replace(study, scenes=tuple(beside))


def _cutoffs_hz(sensors: dict[str, Any], file: Path) -> tuple[float, ...] | None:
    """Take the cutoffs out of the table: TOML knows inf, which other numbers may not be."""
    for field, to_hz in (("cutoffs_hz", float), ("illuminance_lux", cutoff_in_light)):
        found = sensors.pop(field, None)
        if found is None:
            continue
        good = isinstance(found, list) and all(
            type(value) in (int, float) and value > 0 for value in found
        )
        if not good:
            raise StudyError(
                f"{file}: simulate.{field}: found {found!r}, expected a list of positive numbers, "
                "of which inf is one"
            )
        if set(sensors) & {"cutoffs_hz", "illuminance_lux"}:
            raise StudyError(f"{file}: simulate: found both cutoffs_hz and illuminance_lux")
        return tuple(math.inf if math.isinf(value) else to_hz(value) for value in found)
    return None
