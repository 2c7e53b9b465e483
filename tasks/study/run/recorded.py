"""The folder of a run whose events were recorded, so that claims and report read it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eres_render.storage.atomic import write_text
from tasks.provenance import command, environment


def write_recorded(out: Path, recordings: Sequence[Path], settings: Mapping[str, Any]) -> None:
    """Write study.json and environment.json of a run; rows.parquet makes it whole.

    Parameters
    ----------
    out
        Folder of the run.
    recordings
        Folders of the events; study.json lists them as `recorded`, where that of a study says what
        is rendered.
    settings
        What was scored.
    """
    config = {
        "name": "rig",
        "question": "Which distance from the print is best?",
        "recorded": [str(folder.absolute()) for folder in recordings],
        "evaluate": dict(settings),
    }
    found = {"command": command(), **environment()}
    for name, content in (("study.json", config), ("environment.json", found)):
        write_text(out / name, json.dumps(content, indent=1) + "\n")
