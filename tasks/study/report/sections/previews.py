"""Show pictures of each scene: the radiance and the events of each sensor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tasks.errors import ResultError
from tasks.study.report.finished_run import FinishedRun, read_json

_FIELDS = {"file", "scene", "width", "cutoff_hz", "speed", "kind", "caption"}


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG picture in base64."""

    kind: str  # "frame" or "events"
    png: str
    caption: str
    width: int
    cutoff_hz: float
    speed: float


def previews(run: FinishedRun) -> dict[str, list[Picture]]:
    """Collect the pictures of each scene, by descending cutoff, speed and width.

    Raises
    ------
    ResultError
        An entry lacks a field or has an unknown kind, or its file is missing.
    """
    index = run.folder / "previews" / "index.json"
    entries = [_checked(index, one) for one in read_json(index, list)] if index.is_file() else []
    found: dict[str, list[Picture]] = {}
    for entry in entries:
        png = run.picture(f"previews/{entry['file']}", "previews/index.json lists it")
        setting = float(entry["cutoff_hz"]), float(entry["speed"])
        picture = Picture(entry["kind"], png, entry["caption"], entry["width"], *setting)
        found.setdefault(entry["scene"], []).append(picture)
    for pictures in found.values():
        pictures.sort(key=lambda one: (-one.cutoff_hz, one.speed, one.width))
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
