"""How long methods and scores take, in seconds of one core, to foretell the cost of a study."""

from __future__ import annotations

from tasks.registry import TASKS, Cost

FARTHER = 2.0
"""Times as long as `Cost.path_s` that tracking takes from the study's other starts."""

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


def cost_of(task: str, method: str) -> Cost:
    """Return the cost of a method; if it is not known, the mean answer of the task's others."""
    spec = TASKS[task]
    if (known := spec.method(method).cost) is not None:
        return known
    costs = [cost for name in spec.methods if (cost := spec.method(name).cost)]
    answers_s = [cost.answer_s for cost in costs if cost.answer_s]
    return Cost(sum(answers_s) / len(answers_s)) if answers_s else costs[0]
