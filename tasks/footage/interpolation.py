"""Motion-compensated frames between the frames of footage."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eres_render.cores import cores
from tasks.footage.footage import Footage
from tasks.footage.motion import gray, optical_flow
from tasks.footage.warping import blend, coefficients, find_later

Float32 = NDArray[np.float32]

_MAX_PX = 0.5  # largest motion per step
_ROWS = 64  # that a thread computes at a time


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
        ends = (_End(light, footage.white_level) for light in footage)
        with ThreadPoolExecutor(cores(), thread_name_prefix="in between") as workers:
            for (before, after), n in zip(pairwise(ends), steps, strict=True):
                yield before.light
                if n > 1:
                    yield from _between(before, after, n, workers)
        yield after.light

    return replace(footage, t_s=np.append(np.concatenate(inside), footage.t_s[-1]), frames=frames)


@dataclass(frozen=True, eq=False)
class _End:
    """A frame of the footage, with what is computed once for the intervals before and after it."""

    light: Float32
    white_level: float

    @cached_property
    def gray(self) -> NDArray[np.uint8]:
        return gray(self.light, self.white_level)

    @cached_property
    def spline(self) -> Float32:
        return coefficients(self.light)


def _between(before: _End, after: _End, steps: int, workers: Executor) -> Iterator[Float32]:
    flow = optical_flow(before.gray, after.gray)
    later = np.empty_like(flow)
    find_later(flow, later)
    starts = range(0, len(flow), _ROWS)
    for k in range(1, steps):
        frame = np.empty(flow.shape[:2], np.float32)
        bands = [frame[start : start + _ROWS] for start in starts]
        blended = partial(blend, before.spline, after.spline, flow, later, k / steps)
        list(workers.map(blended, starts, bands))
        yield frame
