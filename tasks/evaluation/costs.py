"""How long methods and scores take, in seconds of one core, to foretell the cost of a study."""

from __future__ import annotations

from tasks.registry import TASKS, Cost

_FARTHER = 2.0  # times as long, from the study's other starts

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


def _cost(task: str, method: str) -> Cost | None:
    """Return the cost of a method; None if it is not known."""
    found = TASKS[task].method(method)
    return Cost() if found.role == "baseline" else found.cost


def answer_s(task: str, method: str) -> float:
    """Return the core seconds of one answer at 1280 px; if not known, the mean of the others."""
    if (cost := _cost(task, method)) is not None:
        return cost.answer_s
    costs = (_cost(task, name) for name in TASKS[task].methods)
    known = [cost.answer_s for cost in costs if cost and cost.answer_s]
    return sum(known) / len(known)


def window_s(method: str) -> float:
    """Return the core seconds of a network for video in one window at 1280 px; 0 for others."""
    cost = _cost("video", method)
    return cost.window_s if cost else 0.0


def paths_s(method: str, max_events: int, starts: int) -> float:
    """Return the core seconds of one path from each start, at any width."""
    cost = _cost("tracking", method) or _cost("tracking", "photometric_tracking") or Cost()
    return (cost.path_s + cost.event_s * max_events) * (1 + _FARTHER * (starts - 1))
