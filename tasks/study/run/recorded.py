"""The folder of a run on recorded events, which claims and report read like any other."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eres_render.storage.atomic import write_text
from eres_render.storage.settings_reader import read_json
from tasks.errors import StudyError
from tasks.provenance import command, environment


def check_recorded(out: Path) -> None:
    """Refuse to write into the folder of a rendered study."""
    file = out / "study.json"
    if file.exists() and "recorded" not in read_json(dict[str, Any], file, StudyError):
        raise StudyError(f"{file}: belongs to a rendered study; choose another --out")


def write_recorded(out: Path, recordings: Sequence[Path], settings: Mapping[str, Any]) -> None:
    """Write study.json and environment.json of a run; the caller adds rows.parquet.

    Parameters
    ----------
    recordings
        Folders of the events; study.json lists them under `recorded`, in place of the settings of
        a rendered study.
    """
    config = {
        "name": "rig",
        "question": "Which distance from the print is best?",
        "recorded": [str(folder.absolute()) for folder in recordings],
        "evaluate": dict(settings),
    }
    versions = {"command": command(), **environment()}
    for name, content in (("study.json", config), ("environment.json", versions)):
        write_text(out / name, json.dumps(content, indent=1) + "\n")
