"""Simulate a sensor on footage, and write its events."""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

from eres_render.progress import Progress, silent
from sensor import ReadoutReport, SensorModel
from sensor.formats.header import Value
from tasks.errors import TaskError
from tasks.events.overwriting import check_new
from tasks.events.simulation import AS_IN_THE_FRAMES, SimulationOptions, seen_part, simulate_frames
from tasks.extras import install, is_installed
from tasks.footage import Footage

_log = logging.getLogger(__name__)

_MAX_STEPS = 1000  # half a pixel each; optical flow does not follow motion of 500 px


def simulate_footage(
    footage: Footage,
    model: SensorModel,
    out: str | Path,
    options: SimulationOptions = AS_IN_THE_FRAMES,
    *,
    interpolate: str | None = None,
    on_progress: Progress = silent,
) -> tuple[int, ReadoutReport | None]:
    """Write the events that a sensor fires on footage.

    The log states the assumed encoding. Warnings estimate on a few frames how many events are lost
    between frames, without interpolation, and how many are noise of the frames; another counts the
    pixels that had no light.

    Parameters
    ----------
    footage
        The footage.
    model
        The sensor.
    out
        The file.
    options
        Speed, seed, bus, and how to write the file.
    interpolate
        Number of intervals into which each interval between frames is divided by
        motion-compensated frames, or "auto", which limits motion to half a pixel a frame.
    on_progress
        Called after each frame.

    Returns
    -------
    The number of events, and the report of the bus, None without a bus.

    Raises
    ------
    TaskError
        The file exists, the sensor is finer than the frames, or `interpolate` is neither a number
        from 1 to 1000 nor "auto".
    """
    out = Path(out)
    check_new(out, options.overwrite, footage.path)
    if interpolate not in (None, "auto", *map(str, range(1, _MAX_STEPS + 1))):
        expected = f"1 to {_MAX_STEPS}, or auto, which limits motion to half a pixel per frame"
        raise TaskError(f"interpolate: found {interpolate!r}, expected {expected}")
    part = seen_part(footage, footage.path, model)  # before the frames are measured
    _log.info(
        "%s: %d frames of %dx%d px in %.4g s, encoding %s",
        footage.path,
        len(footage),
        footage.width,
        footage.height,
        footage.t_s[-1] - footage.t_s[0],
        footage.encoding,
    )
    origin: dict[str, Value] = {"footage": footage.path.name, "encoding": footage.encoding}
    if footage.fps is not None:
        origin["fps"] = footage.fps
    check, frames, between = None, footage, None
    if interpolate is not None or is_installed("cv2"):
        from tasks.events.footage_check import FootageCheck

        dense = interpolate is not None
        check = FootageCheck(footage, part, model, options.speed, with_between=dense)
        frames = check.watched()
    else:
        _log.warning(
            "events that are lost between frames, or noise of the frames, are not estimated, as "
            "OpenCV is not installed: %s",
            install("video"),
        )
    if interpolate is not None:
        from tasks.footage.interpolation import timed_frames

        steps = None if interpolate == "auto" else [int(interpolate)] * (len(footage) - 1)
        sensor_px = model.width / (part[1].stop - part[1].start)
        between = partial(timed_frames, steps=steps, sensor_px=sensor_px)
        origin["interpolate"] = interpolate
    result = simulate_frames(
        frames,
        model,
        out,
        options,
        origin=origin,
        between=between,
        on_events=None if check is None else check.count,
        on_progress=on_progress,
    )
    if check is not None:
        check.warn()
    if footage.mender is not None:
        footage.mender.warn(footage.path)
    return result
