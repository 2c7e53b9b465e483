"""`Recording`: a file of events of any format, read in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eres_render.progress import Progress
from sensor.events import Events, concatenate
from sensor.formats import Header, read_header
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, ReadOptions

_ALL_US = -(1 << 63), 1 << 63


@dataclass(frozen=True, slots=True)
class Recording:
    """The events of a file, all or those of a part of its time.

    Parameters
    ----------
    path, header
        The file, and its header with a size.
    start_us, end_us
        From the first event to just after the last: [start_us, end_us).
    count
        Number of events.
    reading, format
        How to read the file.
    """

    path: Path
    header: Header
    start_us: int
    end_us: int
    count: int
    reading: ReadOptions = AS_STORED
    format: str | None = None

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor, px."""
        return self.header.size

    @property
    def event_rate_hz(self) -> float:
        """Events per second of the whole sensor, from the first event to the last."""
        return 1e6 * self.count / (self.end_us - self.start_us)

    def parts(self) -> Iterator[Events]:
        """Read the file in parts."""
        return _between(self.reading.parts(self.path, self.format), self.start_us, self.end_us)

    def counted(self, stage: str, on_progress: Progress) -> Iterator[Events]:
        """Read the file in parts, and report progress after each.

        Parameters
        ----------
        stage
            What the events are read for, as `on_progress` gets it.
        on_progress
            Called with the number of events so far, and of all.

        Returns
        -------
        The parts.
        """
        done = 0
        for events in self.parts():
            yield events
            done += len(events)
            on_progress(stage, done, self.count)


def open_recording(
    path: str | Path,
    *,
    format: str | None = None,
    reading: ReadOptions = AS_STORED,
    span_us: tuple[int, int] = _ALL_US,
) -> Recording:
    """Open a file of events; reads all of it once, for its times and number of events.

    Parameters
    ----------
    path
        The file.
    format
        Its format; by default that of its extension or header.
    reading
        How to read it.
    span_us
        Which events to take, [start, end), us; by default all.

    Returns
    -------
    Recording

    Raises
    ------
    EventFormatError
        The file is damaged, or its size is neither stored nor given.
    TaskError
        The file has no events, or none of these times.
    """
    path = Path(path)
    parts = reading.parts(path, format)
    header = read_header(path, format=format, topic=reading.topic).with_size(reading.size)
    ends_us: list[int] = []
    count = 0
    for part in _between(parts, *span_us):
        ends_us += part.t_us[[0, -1]].tolist() if len(part) else []
        count += len(part)
    if not count:
        where = "" if span_us == _ALL_US else " in the time to show"
        raise TaskError(f"{path}: has no events{where}")
    return Recording(path, header, ends_us[0], ends_us[-1] + 1, count, reading, format)


def _between(parts: Iterable[Events], start_us: int, end_us: int) -> Iterator[Events]:
    """Yield the events in [start_us, end_us); reads no more than these."""
    for part in parts:
        yield part.between(start_us, end_us)
        if len(part) and part.t_us[-1] >= end_us:
            return


def cut(parts: Iterable[Events], windows_us: Sequence[tuple[int, int]]) -> Iterator[Events]:
    """Cut windows out of a stream, with at most a window and a part in memory.

    Parameters
    ----------
    parts
        Parts of the stream, at least one.
    windows_us
        Start and end of each window, [start, end); both ascend. Windows may overlap.

    Yields
    ------
    Events
        Events of each window.
    """
    stream = iter(parts)
    held = next(stream)
    for start_us, end_us in windows_us:
        slices = [held[int(np.searchsorted(held.t_us, start_us)) :]]
        while not (len(slices[-1]) and slices[-1].t_us[-1] >= end_us):
            if (part := next(stream, None)) is None:
                break
            slices = list(filter(len, slices))  # an empty slice keeps its part in memory
            slices.append(part[int(np.searchsorted(part.t_us, start_us)) :])
        held = concatenate(list(filter(len, slices)) or slices[:1])
        yield held[: int(np.searchsorted(held.t_us, end_us))]
