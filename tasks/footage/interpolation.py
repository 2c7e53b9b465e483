"""Motion-compensated frames between the frames of footage."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.footage.footage import Footage
from tasks.footage.motion import gray, optical_flow

Float32 = NDArray[np.float32]

_MAX_PX = 0.5  # largest motion per step


def steps_for(displacements_px: NDArray[np.float64]) -> list[int]:
    """Return how finely to divide intervals so that a step has at most half a pixel of motion.

    Parameters
    ----------
    displacements_px
        (T - 1,) motion in each interval, px.

    Returns
    -------
    (T - 1,) numbers of steps.
    """
    return [max(1, math.ceil(shift / _MAX_PX)) for shift in displacements_px]


def interpolated(footage: Footage, steps: Sequence[int]) -> Footage:
    """Return footage with motion-compensated frames between its own.

    Parameters
    ----------
    steps
        (T - 1,) number of intervals into which each interval of the footage is divided.
    """
    own = pairwise(footage.t_s)
    inside = [a + (b - a) * np.arange(n) / n for (a, b), n in zip(own, steps, strict=True)]

    def frames() -> Iterator[Float32]:
        for (before, after), n in zip(pairwise(footage), steps, strict=True):
            yield before
            if n > 1:
                between = _Between(before, after, footage.white_level)
                yield from (between.at(k / n) for k in range(1, n))
        yield after

    return replace(footage, t_s=np.append(np.concatenate(inside), footage.t_s[-1]), frames=frames)


class _Between:
    """Frames between two frames: both are moved along the flow to the time in between and blended.

    The flow at the time in between comes from those of both frames (Jiang et al., Super SloMo, CVPR
    2018, Eq. 4). Where a frame does not show what the other shows, its weight is lower.
    """

    def __init__(self, before: Float32, after: Float32, white_level: float) -> None:
        self.ends = before, after
        first, second = (gray(frame, white_level) for frame in self.ends)
        self.forth, self.back = optical_flow(first, second), optical_flow(second, first)
        rows, columns = (np.arange(side, dtype=np.float32) for side in before.shape)
        self.grid = np.dstack(np.meshgrid(columns, rows))
        flows = (self.forth, self.back), (self.back, self.forth)
        self.visible = [_consistency(self.grid, *pair) for pair in flows]

    def at(self, t: float) -> Float32:
        """Return the frame at a time between 0 and 1."""
        to_first = -(1 - t) * t * self.forth + t * t * self.back
        to_second = (1 - t) ** 2 * self.forth - t * (1 - t) * self.back
        total, weights = np.zeros((2, *self.ends[0].shape), np.float32)
        shifts = (to_first, 1 - t), (to_second, t)
        for image, visible, (shift, near) in zip(self.ends, self.visible, shifts, strict=True):
            at = self.grid + shift
            weight = near * (_sample(visible, at, cv2.INTER_LINEAR) + 1e-3)
            total += weight * _sample(image, at, cv2.INTER_LANCZOS4)
            weights += weight
        frame: Float32 = np.maximum(total / weights, 0)
        return frame


def _consistency(grid: Float32, forth: Float32, back: Float32) -> Float32:
    """Return 1 where a point comes back to itself, and less where it does not, as it is hidden."""
    missed = forth + _sample(back, grid + forth, cv2.INTER_LINEAR)
    error: Float32 = np.einsum("yxc,yxc->yx", missed, missed)
    return np.exp(-error)


def _sample(image: Float32, at: Float32, interpolation: int) -> Float32:
    """Sample an image at (H, W, 2) positions; beyond its border, the border is repeated."""
    x, y = at[..., 0], at[..., 1]
    return np.asarray(cv2.remap(image, x, y, interpolation, borderMode=cv2.BORDER_REPLICATE))
