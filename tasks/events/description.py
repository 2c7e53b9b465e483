"""Describe a file of events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from sensor.formats import Triggers, find_format, read_header, read_triggers
from sensor.formats.header import model_to_json
from sensor.model import MAX_SIDE_PX
from tasks.events.reading import AS_STORED, ReadOptions


def describe(
    path: Path, *, format: str | None = None, reading: ReadOptions = AS_STORED
) -> dict[str, str]:
    """Describe an event file, which is read as a whole; without a size, events may be anywhere."""
    header = read_header(path, format=format, topic=reading.topic)
    note = "" if header.width is not None else " as given, size not stored"
    sensor = "{}x{} px".format(*(reading.size or (header.width, header.height))) + note
    if note and reading.size is None:
        sensor = "size not stored"
        reading = replace(reading, size=(MAX_SIDE_PX, MAX_SIDE_PX))
    count, brighter, first_us, last_us = 0, 0, None, 0
    for part in reading.parts(path, format):
        if len(part):
            first_us = int(part.t_us[0]) if first_us is None else first_us
            last_us = int(part.t_us[-1])
        count += len(part)
        brighter += int(np.count_nonzero(part.p > 0))
    size_bytes = path.stat().st_size
    each = f", {size_bytes / count:.2f} an event" if count else ""
    lines = {"format": find_format(path, format).title, "sensor": sensor}
    lines |= {"file": f"{size_bytes} bytes{each}", "events": str(count)}
    if header.t_offset_us:
        lines["clock starts at"] = f"{seconds(header.t_offset_us)} s"
    if first_us is not None:
        span_s = (last_us - first_us) * 1e-6
        lines["time"] = f"{seconds(first_us)} to {seconds(last_us)} s"
        lines["rate"] = f"{count / span_s * 1e-6:.4g} Mev/s" if span_s else "all at one time"
        lines["brighter"] = f"{100 * brighter / count:.2f} % of the events"
    lines |= _edges(read_triggers(path, format=format))
    if header.model is not None:
        lines["sensor model"] = model_to_json(header.model)
    lines |= {name.replace("_", " "): str(value) for name, value in header.origin.items()}
    return lines | ({"also holds": ", ".join(header.others)} if header.others else {})


def seconds(t_us: int) -> str:
    """Write microseconds as seconds with all digits."""
    sign, whole = "-" if t_us < 0 else "", abs(t_us)
    return f"{sign}{whole // 10**6}.{whole % 10**6:06}"


def _edges(triggers: Triggers) -> dict[str, str]:
    """Describe the triggers of each channel."""
    channels = []
    for channel in np.unique(triggers.channel):
        t_us = triggers.t_us[triggers.channel == channel]
        span = f"{seconds(int(t_us[0]))} to {seconds(int(t_us[-1]))} s"
        channels.append(f"{len(t_us)} on channel {channel}, {span}")
    return {"triggers": "; ".join(channels)} if channels else {}
