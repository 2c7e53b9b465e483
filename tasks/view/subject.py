"""The sources of pictures, and the time that they cover."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from eres_render import RadianceSequence, open_sequence
from eres_render.progress import Progress
from sensor import EventCamera, find_camera
from sensor.events import Events, concatenate
from sensor.formats import Header
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, NO_FOOTAGE, FootageOptions, ReadOptions
from tasks.events.simulation import FASTEST
from tasks.footage import Footage
from tasks.origin import in_text, shift_us
from tasks.recording.recording import Recording, cut, open_recording
from tasks.view.clip import ClipFrames, ClipSource, Show, TimedFrames, clip_source
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
        """Return a panel for each of the ascending times, us."""
        return (panel for _, panel in self.drawn(times_us))

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
            us = length_us or (t_us - int(events.t_us[0]) if len(events) else 1)
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


@dataclass(frozen=True, slots=True)
class Subject:
    """The sources to show, and the part of the time that they cover together, us."""

    sources: tuple[Source, ...]
    start_us: int
    end_us: int

    @property
    def event_sources(self) -> tuple[EventSource, ...]:
        """The sources that are files of events."""
        return tuple(source for source in self.sources if isinstance(source, EventSource))


def open_subject(
    paths: Sequence[Path],
    look: Look,
    *,
    over: Path | None,
    show: Show,
    reading: ReadOptions,
    format: str | None,
    on_progress: Progress,
) -> Subject:
    """Open files of events and rendered clips, and find the time that they cover."""
    files = [path for path in paths if not path.is_dir()]
    of_events = {
        "--over": over,
        "--format": format,
        "--size, --time-unit, --sort, --topic": None if reading == AS_STORED else reading,
        "--window": look.window,
        "--count": look.count,
    }
    given = [name for name, value in of_events.items() if value is not None]
    if given and not files:
        raise TaskError(f"{', '.join(given)}: only for files of events; SOURCE is a rendered clip")
    if len(files) == len(paths) and show != "frames":
        raise TaskError(f"--show {show}: only for rendered clips; SOURCE is a file of events")
    camera = EventCamera() if look.sensor is None else find_camera(look.sensor)
    if look.sensor is not None and reading.size is None:
        reading = replace(reading, size=camera.size)
    clips = {path: open_sequence(path) for path in paths if path not in files}
    recordings = {}
    for k, path in enumerate(files):
        on_progress("reading", k, len(files))
        recordings[path] = open_recording(
            path, format=format, reading=reading, span_us=look.span_us
        )
    headers = {path: recording.header for path, recording in recordings.items()}

    def source(path: Path) -> Source:
        if path in clips:
            return clip_source(_rendered(clips[path], headers), show)
        frames = None if over is None else _behind(over, path, headers[path])
        return EventSource(recordings[path], look, frames, camera.name)

    sources = tuple(map(source, paths))
    shown = {source.frames for source in sources if source.frames is not None}
    spans_us = [(recording.start_us, recording.end_us) for recording in recordings.values()]
    spans_us = spans_us or [frames.span_us() for frames in shown]
    start_us, end_us = look.span_us
    if look.start is None:
        start_us = min(start for start, _ in spans_us)
    if look.end is None:
        end_us = max(end for _, end in spans_us)
    for frames in shown:
        first_us, last_us = frames.span_us()
        if last_us < start_us or first_us > end_us:
            raise TaskError(
                f"{frames.path}: the frames cover {_s(first_us)} to {_s(last_us)} s, "
                f"but the time to show is {_s(start_us)} to {_s(end_us)} s"
            )
    return Subject(sources, start_us, end_us)


def _behind(over: Path, path: Path, header: Header) -> TimedFrames:
    """Return the frames of a clip or of footage on the clock of a file of events."""
    options, origin = NO_FOOTAGE, header.origin
    if origin.get("footage") == in_text(over.name):
        fps, encoding = origin.get("fps"), origin.get("encoding")
        options = FootageOptions(fps=None if fps is None else float(fps), encoding=str(encoding))
    frames = options.open(over)
    if isinstance(frames, Footage):
        return TimedFrames(frames, _speed(path, header))
    return _rendered(frames, {path: header})


def _rendered(sequence: RadianceSequence, headers: Mapping[Path, Header]) -> ClipFrames:
    """Return the frames of a clip on the clock of files of events."""
    clocks = set()
    for path, header in headers.items():
        speed = _speed(path, header)
        clocks.add((speed, shift_us(sequence, header.origin, speed)))
    if len(clocks) > 1:
        names = (f"speed {speed:g}, shifted by {shift} us" for speed, shift in sorted(clocks))
        raise TaskError(
            f"{sequence.folder}: the files of events have different clocks: {'; '.join(names)}"
        )
    return ClipFrames(sequence, *(clocks.pop() if clocks else ()))


def _speed(path: Path, header: Header) -> float:
    """Return the speed at which the events were simulated, 1 if the file does not say."""
    speed = header.origin.get("speed", 1.0)
    if isinstance(speed, str) or not 0 < speed < FASTEST:
        raise TaskError(f"{path}: origin, speed: found {speed!r}, expected a positive number")
    return float(speed)


def _s(t_us: int) -> str:
    return f"{1e-6 * t_us:.6f}"
