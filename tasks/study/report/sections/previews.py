"""The report's section of pictures: the radiance of each scene, and what each sensor saw of it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from tasks.errors import ResultError
from tasks.study.report.markup import scrolling
from tasks.study.results.words import cutoff_detail, cutoff_label, speed_label

_LEGEND = (
    '<p class="lead">Blue: brighter, red: darker, by the sum of polarities over the last 10 ms of '
    "the window; every picture shows the middle quarter of the image’s side.</p>"
)


def previews_html(folder: Path, entries: Sequence[Any]) -> str:
    """Render the section.

    Parameters
    ----------
    folder
        Where the PNG files lie.
    entries
        The content of the folder's ``index.json``: an object for each picture.

    Raises
    ------
    ResultError
        An entry lacks a field or is of an unknown kind, or its file is missing.
    """
    if not entries:
        return "<p>This run has no previews.</p>"
    checked = [_checked(folder, entry) for entry in entries]
    parts = [_LEGEND]
    for scene in dict.fromkeys(entry["scene"] for entry in checked):
        of_scene = [entry for entry in checked if entry["scene"] == scene]
        parts.append(f"<h3>{escape(scene)}</h3>")
        parts += [_shot(folder, entry) for entry in of_scene if entry["kind"] == "frame"]
        if events := [entry for entry in of_scene if entry["kind"] == "events"]:
            parts.append(scrolling(f"Event previews, {scene}", _grid(folder, scene, events)))
    return "".join(parts)


def _checked(folder: Path, entry: Any) -> dict[str, Any]:
    fields = {"file", "scene", "width", "cutoff_hz", "speed", "kind", "caption"}
    found = set(entry) if isinstance(entry, dict) else set()
    if missing := fields - found:
        raise ResultError(
            f"{folder / 'index.json'}: an entry has no {', '.join(sorted(missing))}: {entry!r}"
        )
    if entry["kind"] not in ("events", "frame"):
        raise ResultError(
            f"{folder / 'index.json'}, kind of {entry['file']}: found {entry['kind']!r}, "
            "expected 'events' or 'frame'"
        )
    return entry


def _grid(folder: Path, scene: str, events: Sequence[Mapping[str, Any]]) -> str:
    """Rows: cutoff and speed, from ideal down; columns: widths, ascending."""
    columns = len({entry["width"] for entry in events})
    parts = [
        f'<div class="previews" style="grid-template-columns:repeat({columns},minmax(0,1fr))">'
    ]
    order = sorted(events, key=lambda e: (-float(e["cutoff_hz"]), e["speed"], e["width"]))
    heading = ""
    for entry in order:
        cutoff_hz = float(entry["cutoff_hz"])
        here = f"{cutoff_label(cutoff_hz)}, {cutoff_detail(cutoff_hz)}, "
        here += speed_label(scene, float(entry["speed"]))
        if here != heading:
            parts.append(f"<h4>{escape(here)}</h4>")
            heading = here
        parts.append(_shot(folder, entry))
    return "".join(parts) + "</div>"


def _shot(folder: Path, entry: Mapping[str, Any]) -> str:
    uri = _embedded(folder / entry["file"])
    kind, sharp, note = "events", ' class="pixels"', ""
    if entry["kind"] == "frame":
        kind, sharp, note = "keyframe", "", ", tone-mapped"
    caption = escape(entry["caption"] + note)
    return (
        f'<figure class="{kind}"><button class="shot" type="button" title="Enlarge">'
        f'<img src="{uri}" alt="{caption}"{sharp}></button>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _embedded(path: Path) -> str:
    if not path.is_file():
        raise ResultError(f"{path}: no such file, but previews/index.json lists it")
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"
