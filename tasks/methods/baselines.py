"""The do-nothing baselines, one or two for each task: they ignore the events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.dense_flow import DenseFlowSample
from tasks.flow import FlowEstimate, FlowSample
from tasks.reconstruction import ReconstructionSample
from tasks.tracking import TrackingEstimate, TrackingSample


def keyframe(sample: ReconstructionSample) -> NDArray[np.float64]:
    """Return the keyframe's log intensity, (H, W) float64."""
    return sample.log_keyframe


class BlankVideo:
    """Returns the same uniform image at any time."""

    def __init__(self, width: int, height: int, contrast_threshold: float) -> None:
        self._shape = height, width

    def push(self, events: Events) -> None:
        """Ignore the events."""

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Return zeros, (height, width)."""
        return np.zeros(self._shape)


def initial_flow(sample: FlowSample) -> FlowEstimate:
    """Return the flow from which every search starts."""
    return FlowEstimate(sample.initial)


def zero_flow(sample: DenseFlowSample) -> NDArray[np.float64]:
    """Return zeros, (2, height, width): nothing moves."""
    return np.zeros(sample.shape)


def initial_flow_everywhere(sample: DenseFlowSample) -> NDArray[np.float64]:
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


def initial_path(sample: TrackingSample) -> TrackingEstimate:
    """Return the path from which every search starts."""
    return TrackingEstimate(sample.initial)
