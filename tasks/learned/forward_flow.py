"""The warm start of E-RAFT: the flow of one pair of windows, carried to the next."""

from __future__ import annotations

import torch
from torch import Tensor

from tasks.learned.eraft_network import cells

_LEAST = 1e-15  # keeps the quotient finite where there are no votes


def carried_forward(flow: Tensor) -> Tensor:
    """Move each cell's flow along itself: the start for the next pair of windows.

    Each cell votes with bilinear weights for the cells around its target; each cell takes the
    weighted mean of its votes, or 0 without votes. Both the floor and the ceiling of a coordinate
    count, so an integer coordinate votes twice, as in the published code.

    Parameters
    ----------
    flow
        (1, 2, h, w), in cells, x first.

    Returns
    -------
    (1, 2, h, w).
    """
    height, width = flow.shape[-2:]
    x, y = (cells(height, width).to(flow) + flow)[0]
    total = torch.zeros(3, height * width).to(flow)  # sums of both components and of the weights
    for column in (x.floor(), x.ceil()):
        for row in (y.floor(), y.ceil()):
            share = (1 - (x - column).abs()) * (1 - (y - row).abs())
            inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
            votes = torch.stack([share * flow[0, 0], share * flow[0, 1], share])[:, inside]
            total.index_add_(1, (row * width + column)[inside].long(), votes)
    return (total[:2] / (total[2] + _LEAST)).view(1, 2, height, width)
