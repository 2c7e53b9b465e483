"""Estimate the time and the disk that a dataset takes."""

from __future__ import annotations

from eres_render.cores import cores
from tasks.generation.settings import DatasetSettings

# Means over random scenes, on two cores of a virtual AMD EPYC server, with LLVM.
_MOTION_WIDTHS_S = 1.0  # of the fastest part of the image, its widths a second
_BYTES_PER_PX = 1.4  # of a frame on disk
_SAMPLES_PER_S = 20e6
_FRAME_S = 8e-3  # of work on each frame, whatever its size
_BYTES_AN_EVENT = 4.0
_EVENTS_PER_PX_S = 30.0


def estimate(settings: DatasetSettings, count: int) -> str:
    """Return what sequences take, as a line of text.

    Parameters
    ----------
    settings
        Settings of the dataset.
    count
        Number of sequences to make.

    Returns
    -------
    text
        Frames, disk and time, roughly.
    """
    pixels = settings.width * settings.height
    seconds = settings.warm_up_s + settings.seconds
    motion_px = _MOTION_WIDTHS_S * settings.width * seconds
    frames = count * motion_px / settings.max_displacement_px
    events = count * pixels * seconds * _EVENTS_PER_PX_S * len(settings.cutoffs_hz)
    disk_bytes = frames * pixels * _BYTES_PER_PX + events * _BYTES_AN_EVENT
    work_s = frames * (_FRAME_S + pixels * settings.spp / _SAMPLES_PER_S) * 2 / min(cores(), 2)
    return (
        f"{count} sequence{'s' * (count != 1)} to make: about {frames:.2g} frames, "
        f"{disk_bytes / 1e9:.2g} GB on disk, {max(1, round(work_s / 60))} min"
    )
