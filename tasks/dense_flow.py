"""Dense optical flow: the displacement of every pixel over a window, from all events of two.

Networks such as E-RAFT compare the events of the window with those of the window before. Their flow
is read and scored at the features of `tasks.flow`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensor import Events


@dataclass(frozen=True, eq=False, slots=True)
class DenseFlowSample:
    """What a dense flow method may use: the events of two successive windows of equal length.

    Positions are in pixels of the sensor, (0, 0) at its top-left corner and pixel centers at
    integers + 0.5.

    Parameters
    ----------
    before, during
        All events of the window before, and of the window itself.
    centers_px
        (N, 2) float64, the features at the window's start.
    initial
        (N, 2) float64, their initial flows, px per window.
    """

    before: Events
    during: Events
    centers_px: NDArray[np.float64]
    initial: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the flow: 2 for x and y, height, width."""
        return 2, self.during.height, self.during.width


def flow_at(flow: NDArray[np.floating], points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Read a flow between the centers of pixels.

    Parameters
    ----------
    flow
        (2, h, w), x first.
    points_px
        (N, 2) positions, px.

    Returns
    -------
    (N, 2), interpolated bilinearly; beyond the outermost pixel centers, that of the nearest.

    Examples
    --------
    >>> import numpy as np
    >>> from tasks.dense_flow import flow_at
    >>> flow = np.zeros((2, 2, 3))
    >>> flow[0] = [1, 2, 3]
    >>> flow_at(flow, np.array([[0.5, 0.5], [1.25, 1.0]]))
    array([[1.  , 0.  ],
           [1.75, 0.  ]])
    """
    height, width = flow.shape[1:]
    x, y = np.clip(points_px.T - 0.5, 0, [[width - 1], [height - 1]])
    column, row = x.astype(np.int64), y.astype(np.int64)
    right, down = x - column, y - row
    below, beside = np.minimum(row + 1, height - 1), np.minimum(column + 1, width - 1)
    top = (1 - right) * flow[:, row, column] + right * flow[:, row, beside]
    bottom = (1 - right) * flow[:, below, column] + right * flow[:, below, beside]
    return ((1 - down) * top + down * bottom).T
