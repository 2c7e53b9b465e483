"""Correlation of all pairs of cells, and the part of it that E-RAFT looks up.

All pairs at 1280 px take 3.5 GB. A look-up needs few of them: those of each old cell with the new
ones around its place. A kernel of ours computes just these. It has no gradients and no GPU; there,
a few rows of old cells at a time are correlated with the rows of new cells that they look at,
looked up, and dropped.
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

from tasks.cpu_time import add_cpu_s
from tasks.learned.correlation_kernel import RADIUS, SIDE, look_up

LEVELS = 4
_PLACES = (2 * RADIUS + 1) ** 2  # around each cell
CHANNELS = LEVELS * _PLACES
_CELLS = 640  # old cells of an image at a time, at least a row
_BANDS_A_THREAD = 4  # so that other threads take over the work of a delayed one


class Correlation:
    """Correlation of every old cell with every new one, at four resolutions of the new ones.

    The average over new cells commutes with the inner product, so the new features are pooled.
    Everything is in float32.

    Parameters
    ----------
    old, new
        (N, channels, h, w) features of the cells.
    """

    def __init__(self, old: Tensor, new: Tensor) -> None:
        self._old = (old.permute(0, 2, 3, 1).float() / math.sqrt(old.shape[1])).contiguous()
        self._new = [new.float()]
        for _ in range(1, LEVELS):
            self._new.append(functional.avg_pool2d(self._new[-1], 2))

    def look_up(self, at: Tensor) -> Tensor:
        """Return the correlations around one place for each old cell.

        Parameters
        ----------
        at
            (N, 2, h, w) places, x first, in cells; integers are centers.

        Returns
        -------
        (N, 324, h, w): level by level, then column by column of the offsets from -4 to 4,
        interpolated bilinearly, 0 outside the image.
        """
        if at.is_cpu and not (self._old.requires_grad or self._new[0].requires_grad):
            return self._look_up_by_kernel(at)
        rows = max(1, _CELLS // at.shape[3])
        places = at.permute(0, 2, 3, 1)
        blocks = zip(self._old.split(rows, dim=1), places.split(rows, dim=1), strict=True)
        with torch.autocast(at.device.type, enabled=False):
            correlations = [
                torch.cat(
                    [_around(*block, new, 2**level) for level, new in enumerate(self._new)], dim=1
                )
                for block in blocks
            ]
        return torch.cat(correlations, dim=2)

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
            products = np.empty((SIDE, SIDE), np.float32)
            for image in range(len(old)):
                for level, new in enumerate(levels):
                    around = out[image, ..., _PLACES * level : _PLACES * (level + 1)]
                    scale = np.float32(0.5**level)
                    inputs = old[image], new[image], scale, places[image]
                    look_up(rows[k], rows[k + 1], *inputs, products, around)
            return time.thread_time() - started_s

        with ThreadPoolExecutor(threads) as workers:
            add_cpu_s(sum(workers.map(band, range(len(rows) - 1))))
        return torch.from_numpy(out).permute(0, 3, 1, 2)


def _around(old: Tensor, places: Tensor, new: Tensor, pooled: int) -> Tensor:
    """Return (N, 81, rows, w) correlations of a block of old cells at one resolution.

    Parameters
    ----------
    old, places
        (N, rows, w, channels) features and (N, rows, w, 2) places of the block.
    new
        (N, channels, h', w') features, each the mean of `pooled` x `pooled` cells.
    """
    count, rows, width, channels = old.shape
    x, y = (places / pooled).reshape(-1, 2).T
    first, end = _rows_around(y, new.shape[2])
    rows_seen = new[:, :, first:end]
    products = old.reshape(count, -1, channels) @ rows_seen.flatten(2)
    steps = torch.arange(-RADIUS, RADIUS + 1).to(places)
    # In grid_sample, -1 and 1 are the centers of the first and the last cell.
    columns = 2 * (x[:, None] + steps) / (rows_seen.shape[3] - 1) - 1
    lines = 2 * (y[:, None] - first + steps) / (rows_seen.shape[2] - 1) - 1
    points = torch.stack(
        [columns[:, :, None].expand(-1, -1, len(steps)), lines[:, None].expand(-1, len(steps), -1)],
        dim=-1,
    )
    maps = products.reshape(-1, 1, *rows_seen.shape[2:])
    values = functional.grid_sample(maps, points, align_corners=True)
    return values.reshape(count, rows, width, -1).permute(0, 3, 1, 2)


def _rows_around(y: Tensor, height: int) -> tuple[int, int]:
    """Return the first row that places look at and the one after the last, at least two apart."""
    least, most = (int(end) for end in torch.nan_to_num(y).floor().aminmax())
    first = min(max(least - RADIUS, 0), height - 2)
    last = min(max(most + RADIUS + 1, first + 1), height - 1)
    return first, last + 1
