"""Contrast Maximization (CM): the flow for which warped events form the sharpest image.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and their image is sharpest for the true flow.
"""

from tasks.methods.contrast_maximization.contrast import REFERENCE_TIME, Contrast
from tasks.methods.contrast_maximization.estimator import MIN_EVENTS, estimate

__all__ = ["MIN_EVENTS", "REFERENCE_TIME", "Contrast", "estimate"]
