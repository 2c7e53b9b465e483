"""Warnings about sequences: a warm-up that is too short, frames that are too far apart."""

from __future__ import annotations

import logging
import math

from eres_render import RadianceSequence
from eres_render.trajectory.frame_times import warn_if_far_apart

_log = logging.getLogger(__name__)

_ENOUGH = 6.0  # time constants; the start then has a weight of 1.7 % (two poles)


def warn_if_short(
    sequence: RadianceSequence, cutoff_hz: float, speed: float, windows_before: int = 0
) -> None:
    """Warn if a sensor's filter still depends on the sequence's start when the window begins.

    Parameters
    ----------
    sequence
        The sequence.
    cutoff_hz
        Corner frequency of each of the photoreceptor's poles; inf needs no warm-up.
    speed
        Factor by which the scene moves faster than rendered; it shortens the warm-up.
    windows_before
        Number of windows of the same length before the window whose events are used too.
    """
    start_s = float(sequence.t_s[0])
    window_s = sequence.window_s[1] - sequence.window_s[0]
    seconds = max(0.0, sequence.window_s[0] - windows_before * window_s - start_s) / speed
    is_continuous = start_s == sequence.window_s[0] == 0  # from the path's start: all is scored
    time_constants = 2 * math.pi * cutoff_hz * seconds if math.isfinite(cutoff_hz) else math.inf
    if time_constants < 0.99 * _ENOUGH and not is_continuous:
        _log.warning(
            "the clip's warm-up, %.3g ms, is %.2g time constants of a %.3g Hz filter, expected %g: "
            "the window's first events still depend on where the sequence starts",
            *(1e3 * seconds, time_constants, cutoff_hz, _ENOUGH),
        )


def warn_if_coarse(sequence: RadianceSequence) -> None:
    """Warn if the image moves so far from frame to frame that events are missed."""
    warn_if_far_apart(str(sequence.folder), sequence.manifest.max_displacement_px)
