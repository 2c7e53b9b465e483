"""Contrast Maximization (CM): the flow for which warped events form the sharpest image.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and their image is sharpest for the true flow.
"""

from tasks.methods.contrast_maximization.contrast import EVEN_OFFSET_PX, Contrast
from tasks.methods.contrast_maximization.estimator import (
    AT_BOUND,
    estimate,
    estimate_by_gradient,
    estimate_by_plain_variance,
)

__all__ = [
    "AT_BOUND",
    "EVEN_OFFSET_PX",
    "Contrast",
    "estimate",
    "estimate_by_gradient",
    "estimate_by_plain_variance",
]
