"""The do-nothing baseline of optical flow: the flow from which every search starts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.dense_flow import DenseFlowSample
from tasks.flow import FlowEstimate, FlowSample


def estimate(sample: FlowSample) -> FlowEstimate:
    """Return the initial flow, whatever the events are."""
    return FlowEstimate(sample.initial)


def estimate_everywhere(sample: DenseFlowSample) -> NDArray[np.float64]:
    """Return for each pixel the initial flow of the nearest feature, (2, height, width)."""
    _, height, width = sample.shape
    x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    nearest = np.zeros((height, width), np.int64)
    least = np.full((height, width), np.inf)
    for k, (center_x, center_y) in enumerate(sample.centers_px):
        distance = (x - center_x) ** 2 + (y - center_y) ** 2
        nearest[distance < least] = k
        least = np.minimum(least, distance)
    return sample.initial[nearest].transpose(2, 0, 1)
