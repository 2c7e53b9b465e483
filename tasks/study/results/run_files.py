"""Read the scores and the study of a run from its folder."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

from eres_render.storage.settings_reader import differences, read_json, read_typed
from tasks.errors import ResultError
from tasks.row import read_rows
from tasks.study.results.scores import Scores, by_photoreceptor

# The kinds of what is read from study.json; a run may leave each of them out.
_KINDS: dict[str, Any] = {
    "question": str | None,
    "render": dict[str, Any],
    "evaluate": dict[str, Any],
    "base_m_per_s": dict[str, float],
    "plane_distance_m": dict[str, float],
    "jobs": tuple[Any, ...],
}


def scores_of_run(*folders: Path) -> dict[str, list[Scores]]:
    """Read the scores of a run, as `by_photoreceptor` returns them.

    Several runs of a study with other weights of its networks become a single run.
    """
    rows_of_runs = [read_rows(folder / "rows.parquet") for folder in folders]
    configs = [read_config(folder) for folder in folders]
    for (other, of_other), (folder, config) in combinations(zip(folders, configs, strict=True), 2):
        _check_joined(config, folder / "study.json", of_other, other)
    rows = rows_of_runs[0]
    if len(folders) > 1:
        rows = [
            replace(row, item=row.item * len(folders) + training)
            for training, rows_of_run in enumerate(rows_of_runs)
            for row in rows_of_run
        ]
    render = configs[0].get("render", {})
    square = render.get("height") in (None, render.get("resolution"))
    try:
        return by_photoreceptor(rows, square=square, trainings=len(folders))
    except ResultError as error:
        files = ", ".join(str(folder / "rows.parquet") for folder in folders)
        raise ResultError(f"{files}: {error}") from None


def read_config(folder: Path) -> dict[str, Any]:
    """Read the study of a run from study.json in its folder."""
    file = folder / "study.json"
    config = read_json(dict[str, Any], file, ResultError)
    for name in _KINDS.keys() & config.keys():
        read_typed(_KINDS[name], config[name], file, ResultError, name)
    return config


def _check_joined(
    config: dict[str, Any], file: Path, of_other: dict[str, Any], other: Path
) -> None:
    """Refuse to join a run with another one that does not differ in weights, or in more."""
    decides_nothing = "name", "question", "jobs"
    every = differences(config, of_other)
    differing = [pair for pair in every if pair[0].partition(".")[0] not in decides_nothing]
    others = [pair for pair in differing if not re.match(r"evaluate\.[^.]+\.weights\b", pair[0])]
    if config.get("jobs") == of_other.get("jobs") or len(others) == len(differing):
        raise ResultError(f"{file}: same weights as {other}; joined runs must differ in weights")
    for name, here, expected in others:
        raise ResultError(
            f"{file}: {name}: found {here!r}, but {expected!r} in {other}; joined runs may differ "
            "only in the weights of networks"
        )
