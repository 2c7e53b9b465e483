"""Correlation of all pairs of cells, and the part of it that E-RAFT looks up.

All pairs at 1280 px take 3.5 GB. A look-up needs few of them: those of each old cell with the new
ones around its place. A kernel of ours computes just these. It has no gradients and no GPU; there,
in training on small crops, all pairs are correlated once.
"""

from __future__ import annotations

import math
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from sensor.compiling import compiler
from tasks.cpu_time import add_cpu_s

LEVELS = 4
_RADIUS = 4
_SIDE = 2 * _RADIUS + 2  # cells that interpolation reads along each axis
_PLACES = (2 * _RADIUS + 1) ** 2  # around each cell
CHANNELS = LEVELS * _PLACES
_BANDS_A_THREAD = 4  # so that other threads take over the work of a delayed one


class Correlation:
    """Correlation of each old cell with each new cell, at four resolutions of the new cells.

    Features are (N, channels, h, w). The average over new cells commutes with the inner product, so
    the new features are pooled. All arithmetic is in float32.
    """

    def __init__(self, old: Tensor, new: Tensor) -> None:
        self._old = (old.permute(0, 2, 3, 1).float() / math.sqrt(old.shape[1])).contiguous()
        self._new = [new.float()]
        for _ in range(1, LEVELS):
            self._new.append(functional.avg_pool2d(self._new[-1], 2))

    def look_up(self, at: Tensor) -> Tensor:
        """Return the correlations around one place for each old cell.

        Places are (N, 2, h, w), x first, in cells; integers are centers. The result is
        (N, 324, h, w): level by level, then column by column of the offsets from -4 to 4,
        interpolated bilinearly, 0 outside the image.
        """
        if at.is_cpu and not (self._old.requires_grad or self._new[0].requires_grad):
            return self._look_up_by_kernel(at)
        steps = torch.arange(-_RADIUS, _RADIUS + 1).to(at)
        offsets = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)
        places = at.permute(0, 2, 3, 1).reshape(-1, 1, 1, 2)
        around = []
        for level, products in enumerate(self._products):
            # In grid_sample, -1 and 1 are the centers of the first and the last cell.
            cell = 2 / (torch.tensor([products.shape[3], products.shape[2]]).to(at) - 1)
            points = (places / 2**level * cell - 1) + offsets * cell
            around.append(functional.grid_sample(products, points, align_corners=True).flatten(1))
        count, _, height, width = at.shape
        return torch.cat(around, dim=1).view(count, height, width, -1).permute(0, 3, 1, 2)

    @cached_property
    def _products(self) -> list[Tensor]:
        """Return (N h w, 1, h', w') correlations of all pairs at each resolution."""
        with torch.autocast(self._old.device.type, enabled=False):
            return [
                (self._old.flatten(1, 2) @ new.flatten(2)).view(-1, 1, *new.shape[2:])
                for new in self._new
            ]

    @cached_property
    def _new_by_cell(self) -> list[NDArray[np.float32]]:
        """Return (N, h', w', channels) features at each resolution, as the kernel takes them."""
        return [level.permute(0, 2, 3, 1).contiguous().numpy() for level in self._new]

    def _look_up_by_kernel(self, at: Tensor) -> Tensor:
        old, levels, places = self._old.numpy(), self._new_by_cell, at.contiguous().numpy()
        out = np.empty((*old.shape[:3], CHANNELS), np.float32)
        threads = torch.get_num_threads()
        rows = np.linspace(0, old.shape[1], threads * _BANDS_A_THREAD + 1).astype(int)

        def band(k: int) -> float:
            started_s = time.thread_time()
            products = np.empty((_SIDE, _SIDE), np.float32)
            for image in range(len(old)):
                for level, new in enumerate(levels):
                    around = out[image, ..., _PLACES * level : _PLACES * (level + 1)]
                    inputs = old[image], new[image], np.float32(0.5**level), places[image]
                    _look_up_rows(rows[k], rows[k + 1], *inputs, products, around)
            return time.thread_time() - started_s

        with ThreadPoolExecutor(threads) as workers:
            add_cpu_s(sum(workers.map(band, range(len(rows) - 1))))
        return torch.from_numpy(out).permute(0, 3, 1, 2)


@compiler(fastmath={"contract", "reassoc"}, _nrt=False)
def _look_up_rows(first, last, old, new, scale, places, products, out):
    """Look up the correlations of some rows of old cells at one resolution.

    The 81 places around a cell are one cell apart, so they share 10 x 10 inner products. Features
    are (h, w, channels); each of the new features is the mean of 1 / `scale` cells along each axis.
    Places are (2, h, w), x first, in cells of `old`. `out`, (h, w, 81), is ordered as in
    `Correlation.look_up`, and 0 at places that are not finite. All arrays are float32.
    """
    height, width, channels = new.shape
    for i in range(first, last):
        for j in range(old.shape[1]):
            x, y = scale * places[0, i, j] - _RADIUS, scale * places[1, i, j] - _RADIUS
            around = out[i, j]
            if not (-_SIDE < x < width and -_SIDE < y < height):
                around[:] = 0.0
                continue
            left, top = math.floor(x), math.floor(y)
            for row in range(_SIDE):
                for column in range(_SIDE):
                    total = np.float32(0.0)
                    if 0 <= top + row < height and 0 <= left + column < width:
                        for c in range(channels):
                            total += old[i, j, c] * new[top + row, left + column, c]
                    products[row, column] = total
            right, down = np.float32(x - left), np.float32(y - top)
            for column in range(_SIDE - 1):
                for row in range(_SIDE - 1):
                    near, far = products[row], products[row + 1]
                    upper = near[column] + right * (near[column + 1] - near[column])
                    lower = far[column] + right * (far[column + 1] - far[column])
                    around[(_SIDE - 1) * column + row] = upper + down * (lower - upper)
