"""Pictures: the radiance of each scene, and what each sensor saw of it."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tasks.errors import ResultError
from tasks.study.report.finished_run import FinishedRun, read_json

_FIELDS = {"file", "scene", "width", "cutoff_hz", "speed", "kind", "caption"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG picture in base64; `setting` is the cutoff in Hz and the speed."""

    png: str
    caption: str
    setting: tuple[float, float]


@dataclass(frozen=True, slots=True)
class ScenePreviews:
    """One scene: its radiance, and its events by setting from ideal light down, then by width."""

    scene: str
    frames: list[Picture]
    events: list[Picture]
    columns: int


def previews(run: FinishedRun) -> list[ScenePreviews]:
    """Collect the section from ``previews/index.json`` and the files that it lists.

    Raises
    ------
    ResultError
        An entry lacks a field or is of an unknown kind, or its file is missing.
    """
    index = run.folder / "previews" / "index.json"
    entries = [_checked(index, one) for one in read_json(index, list)] if index.is_file() else []
    found = []
    for scene in dict.fromkeys(entry["scene"] for entry in entries):
        of_scene = [entry for entry in entries if entry["scene"] == scene]
        frames = [entry for entry in of_scene if entry["kind"] == "frame"]
        events = [entry for entry in of_scene if entry["kind"] == "events"]
        events.sort(key=lambda e: (-float(e["cutoff_hz"]), e["speed"], e["width"]))
        found.append(
            ScenePreviews(
                scene,
                [_picture(index.parent, entry) for entry in frames],
                [_picture(index.parent, entry) for entry in events],
                columns=len({entry["width"] for entry in events}),
            )
        )
    return found


def _checked(index: Path, entry: Any) -> dict[str, Any]:
    found = set(entry) if isinstance(entry, dict) else set()
    if missing := _FIELDS - found:
        raise ResultError(f"{index}: an entry has no {', '.join(sorted(missing))}: {entry!r}")
    if entry["kind"] not in ("events", "frame"):
        raise ResultError(
            f"{index}, kind of {entry['file']}: found {entry['kind']!r}, expected 'events' or "
            "'frame'"
        )
    return entry


def _picture(folder: Path, entry: Mapping[str, Any]) -> Picture:
    path = folder / entry["file"]
    if not path.is_file():
        raise ResultError(f"{path}: no such file, but previews/index.json lists it")
    png = base64.b64encode(path.read_bytes()).decode()
    return Picture(png, entry["caption"], (float(entry["cutoff_hz"]), float(entry["speed"])))
