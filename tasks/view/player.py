"""A page that plays events in a browser, offline: one HTML file.

The events are drawn over frames if their source has them.
"""

from __future__ import annotations

import base64
import io
import logging
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from PIL import Image

from eres_render.progress import Progress
from eres_render.storage.atomic import write_text
from tasks.errors import TaskError
from tasks.view.drawing import STRENGTHS
from tasks.view.subject import EventSource, Subject

_log = logging.getLogger(__name__)

MAX_EVENTS = 2_000_000
"""Largest number of events of a page, all files together; of more, every second, third, ... is
kept."""
MAX_FRAMES = 200
"""Largest number of frames behind one file; of more, every second, third, ... is kept."""
MAX_PIXELS = 48_000_000
"""Largest number of pixels in all frames of a page; a browser needs 4 bytes for each."""
_MAX_PX = 640  # frames for wider sensors are scaled down
_WEBP_QUALITY = 60

_WINDOWS_MS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # to choose from

_TEMPLATES = Environment(
    loader=PackageLoader("tasks.view"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_player(
    path: Path, subject: Subject, window_ms: float, on_progress: Progress, *, overwrite: bool
) -> None:
    """Write the page of files of events, with an initial window of `window_ms`."""
    sources, span_us = subject.event_sources, (subject.start_us, subject.end_us)
    if span_us[1] - span_us[0] >= 1 << 32:
        raise TaskError(f"{path}: a page holds at most 71 minutes; give --start and --end")
    count = sum(source.recording.count for source in sources)
    every = -(-count // MAX_EVENTS)
    if every > 1:
        _log.warning(
            "%s: keeps one of every %d events, as a page holds at most %d of the %d; give --start "
            "and --end to keep all events of a part",
            path,
            every,
            MAX_EVENTS,
            count,
        )
    packed = []
    for k, source in enumerate(sources, start=1):
        packed.append(_pack(source, span_us[0], every))
        on_progress("packing", k, len(sources))
    for panel, frames in zip(packed, pack_frames(sources, span_us), strict=True):
        panel["frames"] = frames
    palette = sources[0].palette
    page = _TEMPLATES.get_template("player.html").render(
        title=", ".join(source.name for source in sources),
        panels=packed,
        every=every,
        windows_ms=sorted({*_WINDOWS_MS, window_ms}),
        events={
            "start_us": span_us[0],
            "duration_us": span_us[1] - span_us[0],
            "window_ms": window_ms,
            "brighter": palette.brighter,
            "darker": palette.darker,
            "ground": palette.ground,
            "strengths": STRENGTHS,
            "sources": packed,
        },
    )
    write_text(path, page, overwrite=overwrite)


def _pack(source: EventSource, start_us: int, every: int) -> dict[str, Any]:
    """Return the events of a file for a page that starts at `start_us`.

    Its data are Base64 of the columns, little-endian and compressed by zlib: uint32 time since the
    previous event, us (for the first, since the start of the page); uint16 x; uint16 y; uint8
    polarity, 1 for brighter.
    """
    packed = []
    count = 0
    for part in source.recording.parts():
        chosen = slice(-count % every, None, every)
        packed.append([column[chosen].copy() for column in part.columns])
        count += len(part)
    t_us, x, y, p = map(np.concatenate, zip(*packed, strict=True))
    steps = np.diff(t_us, prepend=start_us).astype("<u4")
    columns = steps, x.astype("<u2"), y.astype("<u2"), (p > 0).astype("u1")
    data = zlib.compress(b"".join(column.tobytes() for column in columns), 6)
    width, height = source.size
    return {
        "title": source.title,
        "width": width,
        "height": height,
        "count": len(t_us),
        "every": every,
        "data": base64.b64encode(data).decode(),
    }


def pack_frames(
    sources: Sequence[EventSource], span_us: tuple[int, int]
) -> list[dict[str, Any] | None]:
    """Return the frames behind files of events for a page that shows [start, end), us.

    They are few and small enough for a browser. Each has the time from which it is shown, us after
    the start of the page.
    """
    sizes = [_size(source) for source in sources if source.frames is not None]
    pixels = sum(width * height for width, height in sizes)
    limit = max(1, min(MAX_FRAMES, MAX_PIXELS // max(pixels, 1)))
    return [_packed_frames(source, span_us, limit) for source in sources]


def _size(source: EventSource) -> tuple[int, int]:
    width, height = source.size
    scale = min(1.0, _MAX_PX / width)
    return max(1, round(scale * width)), max(1, round(scale * height))


def _packed_frames(
    source: EventSource, span_us: tuple[int, int], limit: int
) -> dict[str, Any] | None:
    if source.frames is None:
        return None
    times_us = source.frames.times_us(*span_us)
    times_us = times_us[:: -(-len(times_us) // limit)]
    images = []
    for t_us in times_us:
        picture, file = source.frames.seen_by(*_size(source), t_us), io.BytesIO()
        Image.fromarray(picture).save(file, "WEBP", quality=_WEBP_QUALITY, method=4)
        images.append(base64.b64encode(file.getvalue()).decode())
    return {"t_us": [t_us - span_us[0] for t_us in times_us], "images": images}
