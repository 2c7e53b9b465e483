"""Contrast Maximization (CM): the flow for which warped events form the sharpest image.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and their image is sharpest for the true flow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tasks.flow import EVENT_COLUMNS, REACH_SIGMAS, FlowEstimate, FlowSample
from tasks.methods.contrast_maximization.contrast import Contrast, off_grid
from tasks.methods.contrast_maximization.search import find_sharpest

__all__ = [
    "AT_BOUND",
    "UNDETERMINED",
    "Contrast",
    "determined",
    "estimate",
    "estimate_by_gradient",
    "estimate_by_plain_variance",
    "off_grid",
]

MIN_EVENTS = 10
AT_BOUND = "search ended at its bound"
"""Reason for a failure: contrast still grows there."""
UNDETERMINED = "motion undetermined"
"""Reason for a failure: two halves of the events disagree."""
_AGREEMENT = 0.5  # largest difference of their flows, relative to the flow of all events


def estimate(sample: FlowSample, objective: str = "variance") -> FlowEstimate:
    """Estimate the flow with the greatest contrast of the image of warped events.

    Polarity is not used; votes are bilinear, and the image is smoothed by a Gaussian of 1 px. The
    image is large enough for any flow within the bound, so that no vote is lost. The search
    (Nelder-Mead) stays within 4 sigma of the initial flow; an answer at this bound is a failure,
    since contrast can run away on dense texture.

    Parameters
    ----------
    sample
        Events of one patch.
    objective
        As for `Contrast`: "variance", "gradient" for the mean squared gradient magnitude, or "plain
        variance".

    Returns
    -------
    The flow; the initial flow if the search fails.
    """
    if len(sample.t) < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{len(sample.t)} events")
    reach = REACH_SIGMAS * sample.initial_sigma_px
    contrast = Contrast(sample, reach, objective)
    simplex = np.zeros((3, 3))
    simplex[1, 0] = simplex[2, 1] = max(0.5 * sample.initial_sigma_px, 1e-3)
    find_sharpest(contrast.patch, contrast.work, sample.initial, reach, simplex)
    offset = simplex[0, :2]
    if np.abs(offset).max() > 0.98 * reach:
        return FlowEstimate(sample.initial, AT_BOUND)
    return FlowEstimate(sample.initial + offset)


def estimate_by_gradient(sample: FlowSample) -> FlowEstimate:
    """As `estimate`, with the mean squared gradient magnitude as contrast."""
    return estimate(sample, objective="gradient")


def estimate_by_plain_variance(sample: FlowSample) -> FlowEstimate:
    """As `estimate`, with the plain variance of the image of warped events as contrast."""
    return estimate(sample, objective="plain variance")


def determined(method: Callable[[FlowSample], FlowEstimate], sample: FlowSample) -> FlowEstimate:
    """Estimate a flow without an initial guess, and only if the events determine it.

    Events are spread off the pixel grid, on which zero flow is the sharpest. The search always
    ends somewhere, also for noise, and for motion too small to blur the image. So both halves of
    the events, every second event and the others, are also searched alone. If their flows differ
    by more than half of the flow of all events, the standard error is more than a quarter of the
    flow, and the answer is a failure.

    Parameters
    ----------
    method
        `estimate`, `estimate_by_gradient` or `estimate_by_plain_variance`.
    sample
        Events of one patch, with zero as initial flow.

    Returns
    -------
    The flow; zero after a failure.
    """
    if len(sample.t) < 2 * MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{len(sample.t)} events")
    whole = method(off_grid(sample))
    if whole.failure:
        return whole
    first, other = (method(off_grid(_every_second(sample, start))) for start in (0, 1))
    apart_px = np.linalg.norm(first.flow - other.flow)
    clear = apart_px < _AGREEMENT * np.linalg.norm(whole.flow)
    if first.failure or other.failure or not clear:
        return FlowEstimate(sample.initial, UNDETERMINED)
    return whole


def _every_second(sample: FlowSample, start: int) -> FlowSample:
    return replace(sample, **{name: getattr(sample, name)[start::2] for name in EVENT_COLUMNS})
