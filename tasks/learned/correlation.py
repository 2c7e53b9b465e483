"""Correlation of all pairs of cells, and what E-RAFT looks up in it."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

LEVELS = 4
RADIUS = 4
CHANNELS = LEVELS * (2 * RADIUS + 1) ** 2


class Correlation:
    """Correlation of every old cell with every new one, at four resolutions of the new ones.

    The average over new cells commutes with the inner product: the new features are pooled, and
    each level is one matrix product.

    Parameters
    ----------
    old, new
        (1, channels, h, w) features of the cells.

    Attributes
    ----------
    levels
        (h * w, 1, h / 2^l, w / 2^l) float32 for each level l.
    """

    def __init__(self, old: Tensor, new: Tensor) -> None:
        channels = old.shape[1]
        self._size = old.shape[-2:]
        queries = old[0].reshape(channels, -1).T.float() / math.sqrt(channels)
        pooled = new.float()
        self.levels: list[Tensor] = []
        with torch.autocast(old.device.type, enabled=False):  # in float32 everywhere
            for level in range(LEVELS):
                if level:
                    pooled = functional.avg_pool2d(pooled, 2)
                products = queries @ pooled[0].reshape(channels, -1)
                self.levels.append(products.view(-1, 1, *pooled.shape[-2:]))

    def look_up(self, at: Tensor) -> Tensor:
        """Return the correlations around one place for each old cell.

        Parameters
        ----------
        at
            (1, 2, h, w) places, x first, in cells; integers are centers.

        Returns
        -------
        (1, 324, h, w): level by level, column by column of offsets from -4 to 4, interpolated
        bilinearly, 0 outside the image.
        """
        height, width = self._size
        places = at[0].permute(1, 2, 0).reshape(-1, 1, 1, 2)
        steps = torch.arange(-RADIUS, RADIUS + 1).to(at)
        offsets = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)
        found = []
        for level, products in enumerate(self.levels):
            ends = torch.tensor([products.shape[-1] - 1, products.shape[-2] - 1]).to(at)
            points = 2 * (places / 2**level + offsets) / ends - 1
            around = functional.grid_sample(products, points, align_corners=True)
            found.append(around.reshape(height, width, -1))
        return torch.cat(found, dim=-1).permute(2, 0, 1)[None]
