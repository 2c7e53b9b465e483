"""Simulate a sensor on footage, and write its events."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from eres_render.progress import Progress, silent
from sensor import ReadoutReport, SensorModel
from sensor.formats.header import Value
from tasks.errors import TaskError
from tasks.events.overwriting import check_new
from tasks.events.simulation import AS_IN_THE_FRAMES, SimulationOptions, seen_part, simulate_frames
from tasks.extras import install, is_installed
from tasks.footage import Footage

_log = logging.getLogger(__name__)

_FAR_PX = 1.0
_MAX_STEPS = 1000  # half a pixel each; optical flow does not follow motion of 500 px
# Motion from frame to frame, px, and the smallest and largest share of events that is lost on the
# rendered scenes; see docs/footage.md.
_LOST = np.array([[1, 0.09, 0.15], [2, 0.26, 0.40], [4, 0.46, 0.62], [8, 0.65, 0.80]])


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

    The log states the assumed encoding. Without interpolation, a warning estimates how many events
    are lost if things move by more than a pixel of the sensor from frame to frame. Another warning
    counts the pixels that had no light.

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
    _, columns = seen_part(footage, footage.path, model)  # before the frames are measured
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
    sensor_px = model.width / (columns.stop - columns.start)
    if interpolate is None and not is_installed("cv2"):
        _log.warning(
            "how far the image moves from frame to frame is not measured, as OpenCV is not "
            "installed: %s",
            install("video"),
        )
    elif interpolate is None:
        from tasks.footage.motion import displacements_px

        far_px = float(np.median(sensor_px * displacements_px(footage, on_progress)))
        if far_px > _FAR_PX:
            least, most = (100 * np.interp(far_px, _LOST[:, 0], share) for share in _LOST.T[1:])
            _log.warning(
                "the image moves by %.2g px of the sensor from frame to frame; on the packaged "
                "scenes that loses %.0f to %.0f %% of the events. --interpolate auto restores most",
                far_px,
                least,
                most,
            )
    else:
        from tasks.footage.interpolation import interpolated, steps_for
        from tasks.footage.motion import displacements_px

        if interpolate == "auto":
            steps = steps_for(sensor_px * displacements_px(footage, on_progress))
        else:
            steps = [int(interpolate)] * (len(footage) - 1)
        footage = interpolated(footage, steps)
        _log.info("%d frames after interpolation", len(footage))
        origin["interpolate"] = interpolate
    result = simulate_frames(footage, model, out, options, origin=origin, on_progress=on_progress)
    if footage.mender is not None:
        footage.mender.warn(footage.path)
    return result
