"""Estimate the time and the disk space that a dataset takes."""

from __future__ import annotations

from eres_render.cores import cores
from eres_render.progress import cost
from tasks.generation.settings import DatasetSettings

# Means over the first 100 (motion) or 5 (the rest) random scenes of seed 0, on a virtual AMD EPYC
# server, with LLVM.
_MOTION_WIDTHS_S = 0.8  # motion of the fastest part of the image, image widths per second
_EVENTS_PER_PX_S = 55
_BYTES_A_FRAME_PX, _BYTES_A_TRUTH_PX, _BYTES_AN_EVENT = 1.5, 7.5, 2.8
# CPU time
_SEQUENCE_S, _FRAME_S, _SAMPLE_S = 6.0, 12e-3, 110e-9
_MAX_CORES = 2  # cores that one sequence keeps busy


def estimate(settings: DatasetSettings, count: int) -> str:
    """Describe in one line what sequences take."""
    views = count * (1 if settings.baseline_m is None else 2)
    width, height = settings.sensor.size
    pixels = width * height
    seconds = settings.warm_up_s + settings.seconds
    motion_px = _MOTION_WIDTHS_S * width * seconds
    frames = views * (2 + motion_px / settings.max_displacement_px)
    events = views * _EVENTS_PER_PX_S * pixels * seconds
    truths = views * settings.seconds / settings.truth_step_s
    a_file = events * _BYTES_AN_EVENT + truths * pixels * _BYTES_A_TRUTH_PX
    disk_bytes = frames * pixels * _BYTES_A_FRAME_PX + len(settings.cutoffs_hz) * a_file
    cpu_s = views * _SEQUENCE_S + frames * (_FRAME_S + pixels * settings.spp * _SAMPLE_S)
    takes = cost(disk_bytes, cpu_s / min(cores(), _MAX_CORES))
    return f"{count} sequence{'s' * (count != 1)} to make: about {frames:.0f} frames, {takes}"
