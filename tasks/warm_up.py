"""Where a sensor's pixels start before a window; warnings about what a sequence lacks for that."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

from eres_render.sequence.clips import WARM_UP_S

if TYPE_CHECKING:
    from eres_render import RadianceSequence

_log = logging.getLogger(__name__)

TIME_CONSTANTS = 6.0
"""Of a photoreceptor's poles, before a window: the start then has a weight of 1.7 % (two poles)."""

_TIME_RESOLUTION_S = 1e-9
_ENOUGH = 0.99  # of a warm-up


def needed_s(
    cutoff_hz: float,
    speed: float,
    base_s: float = WARM_UP_S,
    time_constants: float = TIME_CONSTANTS,
) -> float:
    """Return how long a sensor has to see the path before its window, s of the path.

    It is at least `base_s`, which lets an ideal pixel's memory forget where it started. `cutoff_hz`
    is the corner frequency of each of the photoreceptor's poles.
    """
    filter_s = time_constants * speed / (2 * math.pi * cutoff_hz)
    return base_s if filter_s <= base_s + _TIME_RESOLUTION_S else filter_s


def warn_of_frames(
    sequence: RadianceSequence,
    cutoff_hz: float,
    speed: float,
    windows_before: int = 0,
    time_constants: float = TIME_CONSTANTS,
) -> None:
    """Warn if frames are far apart, or a sensor's events at the window depend on their start.

    Events of `windows_before` windows before the window are used too.
    """
    from eres_render.trajectory.frame_times import warn_if_far_apart  # SciPy slows down `--help`

    start_s = float(sequence.t_s[0])
    window_s = sequence.window_s[1] - sequence.window_s[0]
    seconds = max(0.0, sequence.window_s[0] - windows_before * window_s - start_s)
    needs_s = needed_s(cutoff_hz, speed, time_constants=time_constants)
    is_continuous = start_s == sequence.window_s[0] == 0  # from the path's start: all is scored
    if seconds < _ENOUGH * needs_s and not is_continuous:
        of_filter = f", {time_constants:g} time constants of a {cutoff_hz:.3g} Hz filter"
        _log.warning(
            "the clip's warm-up is %.3g ms of the path, expected %.3g ms%s: the window's first "
            "events still depend on where the sequence starts; render with a longer --warm-up",
            1e3 * seconds,
            1e3 * needs_s,
            of_filter if needs_s > WARM_UP_S else "",
        )
    warn_if_far_apart(str(sequence.folder), sequence.manifest.max_displacement_px)
