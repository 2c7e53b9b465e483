"""A page that plays events in a browser, offline: one HTML file.

The events are drawn over frames if their source has them.
"""

from __future__ import annotations

import base64
import logging
import zlib
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from eres_render.progress import Progress
from eres_render.storage.atomic import write_text
from tasks.errors import TaskError
from tasks.view.drawing import STRENGTHS
from tasks.view.event_file import EventSource
from tasks.view.player_frames import pack_frames
from tasks.view.subject import Subject

_log = logging.getLogger(__name__)

MAX_EVENTS = 2_000_000
"""Largest number of events of a page, all files together; of more, every second, third, ... is
kept."""

_WINDOWS_MS = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # to choose from

_TEMPLATES = Environment(
    loader=PackageLoader("tasks.view"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True, slots=True)
class PackedEvents:
    """Events of one file, for the page.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    data
        Base64 of the columns, little-endian and compressed by zlib: uint32 time since the previous
        event, us (for the first, since the start of the page); uint16 x; uint16 y; uint8 polarity,
        1 for brighter.
    """

    title: str
    width: int
    height: int
    count: int
    every: int
    data: str


def write_player(
    path: Path, subject: Subject, window_ms: float, on_progress: Progress, *, overwrite: bool
) -> None:
    """Write the page of files of events.

    Parameters
    ----------
    window_ms
        Initial length of the window of events, ms.
    """
    sources, span_us = subject.event_sources, (subject.start_us, subject.end_us)
    if span_us[1] - span_us[0] >= 1 << 32:
        raise TaskError(f"{path}: a page holds at most 71 minutes; give --start and --end")
    count = sum(subject.counts)
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
        packed.append(pack(source, span_us, every))
        on_progress("packing", k, len(sources))
    frames = pack_frames(sources, span_us)
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
            "sources": [
                asdict(events) | {"frames": behind and asdict(behind)}
                for events, behind in zip(packed, frames, strict=True)
            ],
        },
    )
    write_text(path, page, overwrite=overwrite)


def pack(source: EventSource, span_us: tuple[int, int], every: int) -> PackedEvents:
    """Pack the events of a file for the page.

    Parameters
    ----------
    span_us
        The part that is packed, [start, end), us.
    """
    packed: list[tuple[NDArray, ...]] = []
    count = 0
    for part in source.parts():
        inside = part.between(*span_us)
        chosen = slice(-count % every, None, every)
        packed.append(tuple(column[chosen].copy() for column in inside.columns))
        count += len(inside)
        if len(part) and part.t_us[-1] >= span_us[1]:
            break
    t_us, x, y, p = map(np.concatenate, zip(*packed, strict=True))
    steps = np.diff(t_us, prepend=span_us[0]).astype("<u4")
    columns = steps, x.astype("<u2"), y.astype("<u2"), (p > 0).astype("u1")
    data = zlib.compress(b"".join(column.tobytes() for column in columns), 6)
    width, height = source.size
    encoded = base64.b64encode(data).decode()
    return PackedEvents(source.title, width, height, len(t_us), every, encoded)
