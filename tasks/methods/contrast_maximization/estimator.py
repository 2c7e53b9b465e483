"""Estimate the flow of a sample."""

from __future__ import annotations

import numpy as np

from tasks.flow import REACH_SIGMAS, FlowEstimate, FlowSample
from tasks.methods.contrast_maximization.contrast import Contrast
from tasks.methods.contrast_maximization.search import find_sharpest

MIN_EVENTS = 10
AT_BOUND = "search ended at its bound"
"""Reason of a failure: contrast still grows there."""


def estimate(
    sample: FlowSample, objective: str = "variance", offset_px: float = 0.0
) -> FlowEstimate:
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
    offset_px
        Shift of all events along both axes. `EVEN_OFFSET_PX` lets a search leave zero flow, at
        which votes are otherwise sharpest.

    Returns
    -------
    The flow; the initial flow if the search fails.
    """
    if len(sample.t) < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{len(sample.t)} events")
    reach = REACH_SIGMAS * sample.initial_sigma_px
    contrast = Contrast(sample, reach, objective, offset_px)
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
