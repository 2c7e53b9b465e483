"""E-RAFT: dense optical flow from the voxel grids of two windows, by a recurrent network.

Gehrig, Millhäusler, Gehrig and Scaramuzza, "E-RAFT: Dense Optical Flow from Event Cameras" (3DV
2021). Each clip is a sequence of its own, so the search starts at zero flow.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.representations import voxel_grid
from tasks.dense_flow import DenseFlowSample


class Network(Protocol):
    """`tasks.learned.eraft.ERaft`."""

    bins: int

    def flow(self, old: NDArray[np.float32], new: NDArray[np.float32]) -> NDArray[np.float32]:
        """As `ERaft.flow`."""
        ...


def estimate(sample: DenseFlowSample, *, network: Network) -> NDArray[np.float32]:
    """Estimate the flow of every pixel over the window, (2, height, width) px, x first."""

    def grid(events: Events) -> NDArray[np.float32]:
        return voxel_grid(events, network.bins, convention="eraft")

    return network.flow(grid(sample.before), grid(sample.during))
