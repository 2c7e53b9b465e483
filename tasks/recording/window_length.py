"""The length of windows in which the events of a recording move far enough for flow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eres_render.progress import Progress, silent
from sensor import Events
from tasks.evaluation.source import Window
from tasks.methods.contrast_maximization import determined, estimate
from tasks.recording.flow_windows import Start, check, event_corners
from tasks.recording.options import FlowOptions
from tasks.recording.recording import Recording, cut

ENOUGH_PX = 4.0
"""Median errors of contrast maximization in simulated rotations with noise: 30 % of a motion of 1
px, 10 % of 2 px, 4 to 10 % of 4 px; longer windows only take in more change of the motion."""
_MIN_US, _MAX_US = 4_000, 500_000
_PLACES = 5  # in the recording
_CORNERS = 10  # at each place


def with_motion(
    recording: Recording,
    options: FlowOptions,
    notes: list[str],
    *,
    with_before: bool = False,
    on_progress: Progress = silent,
) -> FlowOptions:
    """Choose the length of windows by the motion in them, unless it is given.

    Events should move by `ENOUGH_PX`, or by half of the search range if that is less. At five
    places of the recording, a window is doubled until contrast maximization finds at least half of
    this motion in most of the strongest patches. The length is the median over the places.

    Parameters
    ----------
    recording
        The events.
    options
        Windows and patches.
    notes
        List to append a sentence to, with the length and the reason.
    with_before
        Whether each window needs events for its own length before it.
    on_progress
        Called after each place.

    Returns
    -------
    Options with a length: at most 500 ms, and no longer than the recording.

    Raises
    ------
    TaskError
        An option is out of range.
    """
    if options.window_ms is not None:
        return options
    check(options)
    whole_us = recording.end_us - recording.start_us
    longest_us = min(_MAX_US, max(1, whole_us // (2 if with_before else 1)))
    start = Start(options, recording.size[0])
    enough_px = min(ENOUGH_PX, 0.5 * start.reach_px)
    least_px = 0.5 * enough_px
    begins_us = np.unique(np.linspace(0, whole_us - longest_us, _PLACES).astype(np.int64))
    cuts = [(begin, begin + longest_us) for begin in (recording.start_us + begins_us).tolist()]
    px_per_us = []
    for (begin_us, _), events in zip(cuts, cut(recording.parts(), cuts), strict=True):
        px_per_us.append(_motion(events, begin_us, longest_us, start, least_px))
        on_progress("choosing windows", len(px_per_us), len(cuts))
    usual = float(np.median(px_per_us))
    limit = " (the longest)" if usual * longest_us < enough_px else ""
    length_us = longest_us if limit else int(enough_px / usual)
    length_us -= length_us % 10 ** max(0, len(str(length_us)) - 2)  # two digits
    moves = f"events move by about {usual * length_us:.1f} px"
    if not usual:
        moves = f"most events show no clear motion of {least_px:g} px or more"
    notes.append(f"windows of {length_us / 1000:g} ms{limit}, in which {moves}")
    return replace(options, window_ms=length_us / 1000)


def _motion(events: Events, begin_us: int, longest_us: int, start: Start, least_px: float) -> float:
    """Return the motion in the first window that shows `least_px`, px/us; 0 if none does."""
    length_us = min(_MIN_US, longest_us)
    while True:
        window = Window(begin_us, begin_us + length_us)
        during = events.between(window.start_us, window.end_us)
        corners_px = event_corners(during)[:_CORNERS]
        moved_px: list[float] = []
        for count, corner_px in enumerate(corners_px, start=1):
            flow = determined(estimate, start.sample(during, window, corner_px))
            if not flow.failure:
                moved_px.append(float(np.linalg.norm(flow.flow)))
            elif 2 * (count - len(moved_px)) >= len(corners_px):
                break  # most will not have moved
        if 2 * len(moved_px) > len(corners_px) and (median_px := np.median(moved_px)) >= least_px:
            return float(median_px) / length_us
        if length_us == longest_us:
            return 0.0
        length_us = min(2 * length_us, longest_us)
