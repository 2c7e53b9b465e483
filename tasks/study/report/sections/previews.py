"""The report's section of pictures: the radiance of each scene, and what each sensor saw of it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from tasks.errors import ResultError
from tasks.study.report.markup import scrolling
from tasks.study.results.previews import Preview
from tasks.study.results.words import cutoff_detail, cutoff_label, speed_label

_LEGEND = (
    '<p class="lead">Blue: brighter, red: darker, by the sum of polarities over the last 10 ms of '
    "the window; every picture shows the middle quarter of the image’s side.</p>"
)


def previews_html(folder: Path, entries: Sequence[Preview]) -> str:
    """Render the section.

    Parameters
    ----------
    folder
        Where the PNG files lie.
    entries
        The content of the folder's ``index.json``.

    Raises
    ------
    ResultError
        A file is missing.
    """
    if not entries:
        return "<p>This run has no previews.</p>"
    parts = [_LEGEND]
    for scene in dict.fromkeys(entry.scene for entry in entries):
        of_scene = [entry for entry in entries if entry.scene == scene]
        parts.append(f"<h3>{escape(scene)}</h3>")
        parts += [_shot(folder, entry) for entry in of_scene if entry.kind == "frame"]
        if events := [entry for entry in of_scene if entry.kind == "events"]:
            parts.append(scrolling(f"Event previews, {scene}", _grid(folder, scene, events)))
    return "".join(parts)


def _grid(folder: Path, scene: str, events: Sequence[Preview]) -> str:
    """Rows: cutoff and speed, from ideal down; columns: widths, ascending."""
    columns = len({entry.width for entry in events})
    parts = [
        f'<div class="previews" style="grid-template-columns:repeat({columns},minmax(0,1fr))">'
    ]
    order = sorted(events, key=lambda e: (-e.cutoff_hz, e.speed, e.width))
    heading = ""
    for entry in order:
        here = f"{cutoff_label(entry.cutoff_hz)}, {cutoff_detail(entry.cutoff_hz)}, "
        here += speed_label(scene, entry.speed)
        if here != heading:
            parts.append(f"<h4>{escape(here)}</h4>")
            heading = here
        parts.append(_shot(folder, entry))
    return "".join(parts) + "</div>"


def _shot(folder: Path, entry: Preview) -> str:
    uri = _embedded(folder / entry.file)
    kind, sharp, note = "events", ' class="pixels"', ""
    if entry.kind == "frame":
        kind, sharp, note = "keyframe", "", ", tone-mapped"
    caption = escape(entry.caption + note)
    return (
        f'<figure class="{kind}"><button class="shot" type="button" title="Enlarge">'
        f'<img src="{uri}" alt="{caption}"{sharp}></button>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _embedded(path: Path) -> str:
    if not path.is_file():
        raise ResultError(f"{path}: no such file, but previews/index.json lists it")
    return f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}"
