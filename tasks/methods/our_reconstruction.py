"""Our reconstruction: a small recurrent U-Net like E2VID's, trained on our own simulator.

It differs from E2VID (`tasks.methods.e2vid`) in its input. The voxel grid is in log units, C times
the sum of polarities, not normalized. Further channels hold the sum of all events of each pixel so
far, which decays with each event as in the high-pass filter (`tasks.methods.high_pass_filter`), at
several rates: a fast one is sharp, a slow one keeps large structures, but also ghosts.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.events import Columns
from sensor.representations import voxel_grid
from tasks.methods.e2vid import E2vid
from tasks.methods.high_pass_filter import AHEAD, PER_EVENT_DECAY
from tasks.numerics.compiling import jit_in_place

DECAYS = (0.004, 0.015, 0.25, PER_EVENT_DECAY)
"""Decays per event of the sums; the last is that of the high-pass filter."""


class InputGrids:
    """Turns the events of successive windows into the network's inputs."""

    def __init__(self, width: int, height: int, contrast_threshold: float, bins: int) -> None:
        self._C, self._bins = contrast_threshold, bins
        self._sums = np.zeros((height, width, len(DECAYS)))
        self._left = tuple(math.exp(-decay) for decay in DECAYS)
        self._places = np.empty(AHEAD, np.uint64)

    def push(self, events: Events) -> NDArray[np.float32]:
        """Return the input of the next window, (bins + 4, height, width), log units.

        The voxel grid comes first, then the sums at the window's end in the order of `DECAYS`.
        """
        sums = self._sums.reshape(-1, len(DECAYS))
        _add(sums, events.width, events.columns, self._C, self._left, self._places)
        grid = self._C * voxel_grid(events, self._bins, normalize=False)
        return np.concatenate([grid, np.moveaxis(self._sums, -1, 0)], dtype=np.float32)


class OurReconstruction(E2vid):
    """The network on the events of one sensor; made as `E2vid`."""

    def __init__(self, width: int, height: int, contrast_threshold: float, **options: Any) -> None:
        super().__init__(width, height, contrast_threshold, **options)
        self._inputs = InputGrids(width, height, contrast_threshold, self._network.bins)

    def _grid(self, events: Events) -> NDArray[np.float32]:
        return self._inputs.push(events)


@jit_in_place
def _add(
    sums: NDArray[np.float64],  # (pixels, 4), row by row
    width: int,
    events: Columns,
    C: float,
    left: tuple[float, ...],  # of each sum after an event
    places: NDArray[np.uint64],  # (AHEAD,) overwritten: index of each event's pixel
) -> float:
    # Pixels are read ahead in groups, so that their independent loads overlap.
    t_us, x, y, p = events
    next_row = np.uint64(width)
    touched = 0.0
    for start in range(0, t_us.size, places.size):
        count = min(places.size, t_us.size - start)
        for k in range(count):
            places[k] = y[start + k] * next_row + x[start + k]
        for k in range(count):
            touched += sums[places[k], 0]
        for k in range(count):
            here, step = places[k], p[start + k] * C
            for i in range(len(left)):
                sums[here, i] = sums[here, i] * left[i] + step
    return touched  # so that the compiler keeps the reads
