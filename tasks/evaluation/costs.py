"""How long methods and scores take, in seconds of one core, to foretell the cost of a study.

Rough means over scenes and lights of the runs in docs/results, whose jobs list their times, on two
virtual servers: `python benchmarks/study_costs.py RUN STUDY`. Those of networks are of
`python benchmarks/bench_networks.py`.
"""

from __future__ import annotations

# Of one answer at 1280 px; it is proportional to the number of pixels.
_ANSWER_S = {
    "video": {"high_pass_filter": 0.24, "high_pass_filter_no_event_decay": 0.24},  # one image
    "flow": {  # one patch
        "photometric_flow": 0.04,
        "photometric_flow_unknown_contrast": 0.015,
        "photometric_flow_by_descent": 0.05,
        "photometric_flow_with_delay": 0.03,
        "contrast_maximization": 0.012,
        "contrast_maximization_by_gradient": 0.017,
        "contrast_maximization_by_plain_variance": 0.0035,
    },
    "dense_flow": {"eraft": 20.0, "our_flow_ideal_light": 3.2, "our_flow_all_light": 3.2},
}
_WINDOW_S = {  # of one window at 1280 px
    "e2vid": 9.1,
    "our_reconstruction_ideal_light": 2.9,
    "our_reconstruction_all_light": 2.9,
}
# Of one path from the nearest of the study's starts: a part that is fixed, and one for each event.
_PATH_S = {
    "photometric_tracking": (0.13, 2.2e-6),
    "photometric_tracking_with_delay": (0.21, 3.9e-6),
}
_FARTHER = 2.0  # times as long, from the study's other starts
_FREE = frozenset({"no_events", "blank", "zero_flow", "initial_flow", "initial_path"})

RECONSTRUCTION_S = 0.08
"""To make and score an image of event integration, compared at 1280 px."""

PICTURE_SCORE_S = 0.03
"""To equalize and score an image of a video, compared at 1280 px."""


def share_of_1280(width: int, height: int) -> float:
    """Return the share of 1280 x 1280 px that a sensor, or a patch of it, has.

    Parameters
    ----------
    width, height
        Of the sensor, px; for a patch, whose side follows the width, the width twice.
    """
    return width * height / 1280**2


def answer_s(task: str, method: str) -> float:
    """Return the time of one answer.

    Parameters
    ----------
    task, method
        Names as in `TASKS`; a method of the user's own takes the mean of the others.

    Returns
    -------
    Core seconds at 1280 px.
    """
    known = _ANSWER_S[task]
    if method in _FREE or method in _WINDOW_S:
        return 0.0
    return known.get(method, sum(known.values()) / len(known))


def window_s(method: str) -> float:
    """Return the core seconds of a network for video in one window at 1280 px; 0 for others."""
    return _WINDOW_S.get(method, 0.0)


def paths_s(method: str, max_events: int, starts: int) -> float:
    """Return the time of one path from each start.

    Returns
    -------
    Core seconds, at any width.
    """
    if method in _FREE:
        return 0.0
    fixed_s, event_s = _PATH_S.get(method, _PATH_S["photometric_tracking"])
    return (fixed_s + event_s * max_events) * (1 + _FARTHER * (starts - 1))
