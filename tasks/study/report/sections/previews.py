"""Show pictures of each scene: the radiance and the events of each sensor."""

from __future__ import annotations

from dataclasses import dataclass

from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError
from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.previews import Preview


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
    entries = read_json(tuple[Preview, ...], index, ResultError) if index.is_file() else ()
    found: dict[str, list[Picture]] = {}
    for entry in entries:
        png = run.picture(f"previews/{entry.file}", "previews/index.json lists it")
        setting = entry.cutoff_hz, entry.speed
        picture = Picture(entry.kind, png, entry.caption, entry.width, *setting)
        found.setdefault(entry.scene, []).append(picture)
    for pictures in found.values():
        pictures.sort(key=lambda one: (-one.cutoff_hz, one.speed, one.width))
    return found
