"""The do-nothing baseline of dense optical flow: nothing moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.dense_flow import DenseFlowSample


def estimate(sample: DenseFlowSample) -> NDArray[np.float64]:
    """Return zeros, (2, height, width)."""
    return np.zeros(sample.shape)
