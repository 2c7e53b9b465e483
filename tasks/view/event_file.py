"""Files of events as pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sensor.events import Events, concatenate
from tasks.origin import in_text
from tasks.recording.recording import Recording, cut
from tasks.view.clip import ClipSource, TimedFrames
from tasks.view.drawing import PALETTES, Palette, draw_events, plain
from tasks.view.layout import Panel
from tasks.view.look import Look


@dataclass(frozen=True, slots=True)
class EventSource:
    """A file of events, the frames behind them, and the name of a camera for the caption."""

    recording: Recording
    look: Look
    frames: TimedFrames | None = None
    camera: str = ""

    @property
    def palette(self) -> Palette:
        """The colors."""
        return PALETTES[self.look.palette]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the sensor, px."""
        return self.recording.size

    @property
    def title(self) -> str:
        """Size and cutoff of the sensor, or the file if it is unknown."""
        model = self.recording.header.model
        if model is None:
            return self.camera or self.name
        cutoff = f"{model.cutoff_hz:g} Hz" if np.isfinite(model.cutoff_hz) else "ideal"
        return f"{model.width}x{model.height} px, {cutoff}"

    @property
    def name(self) -> str:
        """Name of the file, as text."""
        return in_text(self.recording.path.name)

    def panels(self, times_us: Sequence[int]) -> Iterator[Panel]:
        """Yield a panel for each of the ascending times, us."""
        for _, panel in self.drawn(times_us):
            yield panel

    def drawn(self, times_us: Sequence[int]) -> Iterator[tuple[Events, Panel]]:
        """Yield the events of each window, and its panel."""
        parts, length_us = self.recording.parts(), self.look.length_us
        if length_us is None:
            windows = last_events(parts, times_us, self.look.count or 0)
        else:
            windows = cut(parts, [(t_us - length_us, t_us) for t_us in times_us])
        ground = plain(*self.size, self.palette.ground)
        for t_us, events in zip(times_us, windows, strict=True):
            if self.frames is not None:
                ground = self.frames.seen_by(*self.size, t_us)
            us = length_us
            if us is None:
                us = t_us - int(events.t_us[0]) if len(events) else 1
            picture = draw_events(events, ground, self.palette)
            # Events per microsecond are millions per second.
            yield events, Panel(picture, self.title, f"{len(events) / us:.3g} Mev/s")


def last_events(parts: Iterable[Events], ends_us: Sequence[int], count: int) -> Iterator[Events]:
    """Yield the last events before each of the ascending times, at most `count`."""
    stream = iter(parts)
    held = next(stream)
    for end_us in ends_us:
        while not (len(held) and held.t_us[-1] >= end_us):
            if (part := next(stream, None)) is None:
                break
            held = concatenate([held[-count:], part])
        stop = int(np.searchsorted(held.t_us, end_us))
        held = held[max(0, stop - count) :]
        yield held[: min(stop, count)]


Source = EventSource | ClipSource
