"""Files of events as pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensor.events import Events
from sensor.formats import Header
from sensor.model import SensorModel
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.origin import in_text
from tasks.view.clip import ClipSource, TimedFrames
from tasks.view.drawing import Palette, draw_events, plain
from tasks.view.layout import Panel
from tasks.view.windows import windows


@dataclass(frozen=True, slots=True)
class EventSource:
    """A file of events.

    Parameters
    ----------
    path, header, format
        The file, its header with a size, and its format; None to infer it from the name.
    length_us, count
        Window of a picture: its length, or its number of events; see `tasks.view.windows.windows`.
    """

    path: Path
    header: Header
    palette: Palette
    length_us: int | None = None
    count: int | None = None
    format: str | None = None
    reading: ReadOptions = AS_STORED
    frames: TimedFrames | None = None
    start_us: int | None = None
    camera: str = ""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor, px."""
        return self.header.size

    @property
    def title(self) -> str:
        """The sensor, or the file if it is unknown."""
        model = self.header.model
        return self.camera or self.name if model is None else sensor_title(model)

    @property
    def name(self) -> str:
        """Name of the file, as text."""
        return in_text(self.path.name)

    def parts(self) -> Iterator[Events]:
        """Read the file."""
        for part in self.reading.parts(self.path, self.format):
            first = 0 if self.start_us is None else int(np.searchsorted(part.t_us, self.start_us))
            yield part[first:]

    def panels(self, times_us: Sequence[int]) -> Iterator[Panel]:
        """Yield a panel for each of the ascending times, us."""
        for _, panel in self.drawn(times_us):
            yield panel

    def drawn(self, times_us: Sequence[int]) -> Iterator[tuple[Events, Panel]]:
        """Yield the events of each window, and its panel."""
        cut = windows(self.parts(), times_us, length_us=self.length_us, count=self.count)
        ground = plain(*self.size, self.palette.ground)
        for t_us, events in zip(times_us, cut, strict=True):
            if self.frames is not None:
                ground = self.frames.seen_by(*self.size, t_us)
            us = self.length_us
            if us is None:
                us = t_us - int(events.t_us[0]) if len(events) else 1
            picture = draw_events(events, ground, self.palette)
            # Events per microsecond are millions per second.
            yield events, Panel(picture, self.title, f"{len(events) / us:.3g} Mev/s")


def sensor_title(model: SensorModel) -> str:
    """Describe a sensor by its size and its cutoff."""
    size = f"{model.width}x{model.height} px"
    return f"{size}, {model.cutoff_hz:g} Hz" if np.isfinite(model.cutoff_hz) else f"{size}, ideal"


Source = EventSource | ClipSource
