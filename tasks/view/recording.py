"""Show clips and events in the Rerun viewer, or write a recording for it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import ground_truth
from eres_render.progress import Progress
from eres_render.storage.atomic import new_file
from sensor.events import Events
from tasks.errors import TaskError
from tasks.view.clip import ClipFrames, DepthSource, FlowSource
from tasks.view.subject import EventSource, Source

_MAX_POINTS = 20_000  # in a window
_MAX_US = (1 << 63) // 1000  # Rerun counts nanoseconds
_PATH_STEPS = 500


def write_recording(
    path: Path | None,
    sources: Sequence[Source],
    times_us: Sequence[int],
    on_progress: Progress,
    *,
    overwrite: bool,
) -> None:
    """Log frames, poses, true depth and flow of clips, and pictures and points of events.

    All sources are logged at the ascending `times_us`, on the timeline "time". The point of an
    event has its column, its row and its age, scaled so that the oldest event is as far away as the
    sensor is wide.
    """
    latest_us = max(map(abs, times_us), default=0)
    if latest_us >= _MAX_US:
        raise TaskError(
            f"{path or 'Rerun'}: cannot store {latest_us} us; run `eres convert --from-start` first"
        )
    with _recording(path, overwrite) as (rerun, recording):
        logs = []
        for place, source in zip(_places(sources), sources, strict=True):
            at = rerun.new_entity_path(place)
            if isinstance(source, EventSource):
                logs.append(_events(rerun, recording, at, source, times_us))
            else:
                logs.append(_clip(rerun, recording, at, source.frames, times_us))
        for k, t_us in enumerate(times_us, start=1):
            recording.set_time("time", duration=np.timedelta64(t_us, "us"))
            for log in logs:
                next(log)
            on_progress("logging", k, len(times_us))


def _places(sources: Sequence[Source]) -> list[list[str]]:
    """Return where each source is in the recording; sources of the same name are numbered."""
    names = [
        ["events", source.name]
        if isinstance(source, EventSource)
        else ["clips", source.frames.sequence.folder.name]
        for source in sources
    ]
    return [
        name if names.count(name) == 1 else [*name, str(names[: k + 1].count(name))]
        for k, name in enumerate(names)
    ]


@contextmanager
def _recording(path: Path | None, overwrite: bool) -> Iterator[tuple[Any, Any]]:
    import rerun

    recording = rerun.RecordingStream("eres")
    if path is None:
        recording.spawn()
        yield rerun, recording
        recording.flush()
        return
    with new_file(path, overwrite=overwrite) as file:
        recording.save(file)
        try:
            yield rerun, recording
        finally:
            recording.disconnect()


def _clip(
    rerun: Any, recording: Any, place: str, frames: ClipFrames, times_us: Sequence[int]
) -> Iterator[None]:
    """Log a clip at one time per step."""
    clip = frames.sequence
    truth = ground_truth(clip)
    depth, flow = DepthSource(frames, truth), FlowSource(frames, truth)
    ends_s = clip.t_s[[0, -1]]
    path = truth.trajectory.pose(np.linspace(ends_s[0], ends_s[1], _PATH_STEPS))[:, :3, 3]
    recording.log(f"{place}/path", rerun.LineStrips3D([path]), static=True)
    for t_us, colors in zip(times_us, flow.panels(times_us), strict=True):
        T = truth.pose(frames.path_s(t_us))
        pose = rerun.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])
        recording.log(f"{place}/camera", pose)
        for name, width, picture in (
            ("frames", clip.width, rerun.Image(frames.at(t_us))),
            ("depth", depth.size[0], rerun.DepthImage(depth.depth(t_us), meter=1.0)),
            ("flow", flow.size[0], rerun.Image(colors.picture)),
        ):
            camera = truth.camera(width)
            size = [camera.width, camera.height]
            lens = rerun.Pinhole(image_from_camera=camera.K, resolution=size)
            recording.log(f"{place}/camera/{name}", lens, picture)
        yield


def _events(
    rerun: Any, recording: Any, place: str, source: EventSource, times_us: Sequence[int]
) -> Iterator[None]:
    """Log a file of events at one time per step."""
    palette = source.palette
    for events, panel in source.drawn(times_us):
        recording.log(f"{place}/image", rerun.Image(panel.picture))
        recording.log(f"{place}/rate", rerun.TextDocument(f"{panel.title}, {panel.detail}"))
        some = events[max(0, len(events) - _MAX_POINTS) :]
        colors = np.where((some.p > 0)[:, None], palette.brighter, palette.darker)
        points = rerun.Points3D(_points(some), colors=colors.astype(np.uint8), radii=0.4)
        recording.log(f"{place}/points", points)
        yield


def _points(events: Events) -> NDArray[np.float32]:
    """Return (N, 3) columns, rows and ages; the largest age is the width of the sensor."""
    if not len(events):
        return np.zeros((0, 3), np.float32)
    age_us = events.t_us[-1] - events.t_us
    age = age_us * (events.width / max(int(age_us[0]), 1))
    return np.stack([events.x, events.y, age], axis=1).astype(np.float32)
