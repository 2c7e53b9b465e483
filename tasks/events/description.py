"""Describe a file of events."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sensor.formats import find_format, read_events, read_header
from sensor.formats.header import Header, model_to_json
from sensor.model import MAX_SIDE_PX


def describe(path: Path, *, format: str | None = None) -> dict[str, str]:
    """Describe an event file; reads all of it.

    Parameters
    ----------
    path
        The file.
    format
        Its format; by default its extension or header tells.

    Returns
    -------
    Names and values to print.
    """
    header = read_header(path, format=format)
    stored = header.width is not None
    size = None if stored else (MAX_SIDE_PX, MAX_SIDE_PX)
    parts = read_events(path, format=format, size=size)
    count, brighter = 0, 0
    first_us, last_us = None, 0
    for part in parts:
        if len(part):
            first_us = int(part.t_us[0]) if first_us is None else first_us
            last_us = int(part.t_us[-1])
        count += len(part)
        brighter += int(np.count_nonzero(part.p > 0))
    size_bytes = path.stat().st_size
    each = f", {size_bytes / count:.2f} an event" if count else ""
    lines = {
        "format": find_format(path, format).title,
        "sensor": f"{header.width}x{header.height} px" if stored else "size not stored",
        "file": f"{size_bytes} bytes{each}",
        "events": str(count),
    }
    if header.t_offset_us:
        lines["clock starts at"] = f"{seconds(header.t_offset_us)} s"
    if first_us is not None:
        span_s = (last_us - first_us) * 1e-6
        lines["time"] = f"{seconds(first_us)} to {seconds(last_us)} s"
        lines["rate"] = f"{count / span_s * 1e-6:.4g} Mev/s" if span_s else "all at one time"
        lines["brighter"] = f"{100 * brighter / count:.2f} % of the events"
    return lines | dict(_made(header))


def seconds(t_us: int) -> str:
    """Write microseconds as seconds with all digits.

    >>> seconds(1600000000123456)
    '1600000000.123456'
    """
    sign, whole = "-" if t_us < 0 else "", abs(t_us)
    return f"{sign}{whole // 10**6}.{whole % 10**6:06}"


def _made(header: Header) -> Iterator[tuple[str, str]]:
    if header.model is not None:
        yield "sensor model", model_to_json(header.model)
    for name, value in header.origin.items():
        yield name.replace("_", " "), str(value)
    if header.others:
        yield "also holds", ", ".join(header.others)
