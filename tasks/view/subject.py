"""The sources of pictures, and the time that they cover."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from eres_render import RadianceSequence, ground_truth, open_sequence
from eres_render.progress import Progress
from sensor.cameras import EventCamera, find_camera
from sensor.errors import EventFormatError
from sensor.formats import Header, read_header
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.events.simulation import FASTEST
from tasks.origin import shift_us
from tasks.view.clip import ClipFrames, ClipSource, DepthSource, FlowSource, FrameSource
from tasks.view.drawing import PALETTES
from tasks.view.event_file import EventSource, Source
from tasks.view.look import Look
from tasks.view.windows import span_of

Show = Literal["frames", "depth", "flow"]


@dataclass(frozen=True, slots=True)
class Subject:
    """The sources to show, and the time that they cover together.

    Parameters
    ----------
    start_us, end_us
        The part of their time that is shown, us.
    """

    sources: tuple[Source, ...]
    start_us: int
    end_us: int
    counts: tuple[int, ...]

    @property
    def event_sources(self) -> tuple[EventSource, ...]:
        """The sources that are files of events."""
        return tuple(one for one in self.sources if isinstance(one, EventSource))


def open_subject(
    paths: Sequence[Path],
    look: Look,
    *,
    over: RadianceSequence | None,
    show: Show,
    reading: ReadOptions,
    format: str | None,
    on_progress: Progress,
) -> Subject:
    """Open files of events and rendered clips, and find the time that they cover."""
    files = [path for path in paths if not path.is_dir()]
    if not files and (format is not None or reading != AS_STORED):
        raise TaskError(
            "found rendered clips, expected format, size, time-unit and sort only with files of "
            "events"
        )
    if not files and over is not None:
        raise TaskError("over: found only rendered clips, expected files of events to draw over it")
    if len(files) == len(paths) and show != "frames":
        raise TaskError(f"show: found {show}, expected it only with a rendered clip as a source")
    camera = EventCamera() if look.sensor is None else find_camera(look.sensor)
    if look.sensor is not None and reading.size is None:
        reading = replace(reading, size=camera.size)
    headers = {path: _header(path, reading, format) for path in files}
    beside_clips = len(files) < len(paths)
    speeds = {
        path: _speed(path, header) if beside_clips or over is not None else 1.0
        for path, header in headers.items()
    }
    if beside_clips and len(set(speeds.values())) > 1:
        found = " and ".join(f"{speed:g}" for speed in sorted(set(speeds.values())))
        raise TaskError(f"found events at speeds {found}, expected one speed next to a clip")
    sources: list[Source] = []
    for path in paths:
        if path in headers:
            frames = None if over is None else _beside(over, {path: headers[path]}, speeds[path])
            sources.append(
                EventSource(
                    path,
                    headers[path],
                    PALETTES[look.palette],
                    length_us=look.length_us,
                    count=look.count,
                    format=format,
                    reading=reading,
                    frames=frames,
                    camera=camera.name,
                )
            )
        else:
            speed = next(iter(speeds.values()), 1.0)
            sources.append(_clip_source(_beside(open_sequence(path), headers, speed), show))
    return _timed(tuple(sources), look, on_progress)


def _header(path: Path, reading: ReadOptions, format: str | None) -> Header:
    header = read_header(path, format=format, topic=reading.topic)
    try:
        return header.with_size(reading.size)
    except EventFormatError as error:
        raise EventFormatError(f"{path}: {error}") from error


def _beside(sequence: RadianceSequence, headers: Mapping[Path, Header], speed: float) -> ClipFrames:
    """Return frames on the clock of files of events."""
    shifts = {shift_us(sequence, header.origin, speed) for header in headers.values()}
    if len(shifts) > 1:
        found = " and ".join(f"{shift} us" for shift in sorted(shifts))
        raise TaskError(f"found events shifted by {found}, expected one clock next to a clip")
    return ClipFrames(sequence, speed, *shifts)


def _speed(path: Path, header: Header) -> float:
    """Return the speed at which the events were simulated, 1 if the file does not say."""
    speed = header.origin.get("speed", 1.0)
    if isinstance(speed, str) or not 0 < speed < FASTEST:
        raise TaskError(f"{path}: found {speed!r} as speed in its origin, expected a factor")
    return float(speed)


def _clip_source(frames: ClipFrames, show: Show) -> ClipSource:
    if show == "frames":
        return FrameSource(frames)
    truth = ground_truth(frames.sequence)
    return DepthSource(frames, truth) if show == "depth" else FlowSource(frames, truth)


def _timed(sources: tuple[Source, ...], look: Look, on_progress: Progress) -> Subject:
    start_us, end_us = (None if t_s is None else round(1e6 * t_s) for t_s in (look.start, look.end))
    if start_us is not None and end_us is not None and not start_us < end_us:
        raise TaskError(f"start, end: found {look.start} to {look.end} s, expected a span")
    files = any(isinstance(source, EventSource) for source in sources)
    starts, ends, counts = [], [], []
    for k, source in enumerate(sources):
        on_progress("reading", k, len(sources))
        if isinstance(source, EventSource):
            span = span_of(source.parts(), start_us, end_us)
            if span is None:
                part = "in the file" if start_us is end_us is None else "between start and end"
                raise TaskError(f"{source.path}: found no events {part}")
            counts.append(span.count)
            starts.append(span.start_us)
            ends.append(span.end_us)
        elif not files:
            first_us, last_us = source.frames.span_us()
            starts.append(first_us)
            ends.append(last_us)
    if start_us is not None:
        sources = tuple(
            replace(source, start_us=start_us) if isinstance(source, EventSource) else source
            for source in sources
        )
    start_us = min(starts) if start_us is None else start_us
    end_us = max(ends) if end_us is None else end_us
    for frames in {source.frames for source in sources if source.frames is not None}:
        _check_overlap(frames, start_us, end_us)
    return Subject(sources, start_us, end_us, tuple(counts))


def _check_overlap(frames: ClipFrames, start_us: int, end_us: int) -> None:
    """Refuse frames outside the time that is shown."""
    first_us, last_us = frames.span_us()
    if last_us < start_us or first_us > end_us:
        raise TaskError(
            f"{frames.sequence.folder}: found frames from {1e-6 * first_us:.6f} to "
            f"{1e-6 * last_us:.6f} s, expected some from {1e-6 * start_us:.6f} to "
            f"{1e-6 * end_us:.6f} s, the time that is shown"
        )
