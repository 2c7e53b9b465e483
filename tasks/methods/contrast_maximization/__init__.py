"""Contrast Maximization (CM): the flow for which warped events form the sharpest image.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and their image is sharpest for the true flow.
"""

from tasks.methods.contrast_maximization.contrast import Contrast, off_grid
from tasks.methods.contrast_maximization.estimator import (
    AT_BOUND,
    UNDETERMINED,
    determined,
    estimate,
    estimate_by_gradient,
    estimate_by_plain_variance,
)

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
