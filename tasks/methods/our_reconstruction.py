"""Our reconstruction: a small recurrent U-Net like E2VID's, trained on our own simulator.

It differs from E2VID (`tasks.methods.e2vid`) in its input. The voxel grid is in log units, C times
the sum of polarities, not normalized. Further channels hold the sum of all events of each pixel so
far, which decays with each event as in the high-pass filter (`tasks.methods.high_pass_filter`), at
several rates: a fast one is sharp, a slow one keeps large structures, but also ghosts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.representations import voxel_grid
from tasks.methods.e2vid import WINDOW_US, E2vid, Network
from tasks.methods.high_pass_filter import PER_EVENT_DECAY, HighPassFilter

DECAYS = (0.004, 0.015, 0.25, PER_EVENT_DECAY)
"""Decays per event of the sums; the last is that of the high-pass filter."""


class InputGrids:
    """Turns the events of successive windows into the network's inputs.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    contrast_threshold
        C, log units.
    bins
        Bins of the voxel grids.
    """

    def __init__(self, width: int, height: int, contrast_threshold: float, bins: int) -> None:
        self._C, self._bins = contrast_threshold, bins
        size = width, height, contrast_threshold
        self._sums = [HighPassFilter(*size, 0.0, decay) for decay in DECAYS]
        self._last_us = 0

    def push(self, events: Events) -> NDArray[np.float32]:
        """Return the input of the next window.

        Parameters
        ----------
        events
            Events of the window.

        Returns
        -------
        (bins + 4, height, width), log units: the voxel grid, and the sums at the window's end in
        the order of `DECAYS`.
        """
        for sums in self._sums:
            sums.push(events)
        if len(events):
            self._last_us = int(events.t_us[-1])
        grid = np.empty((self._bins + len(DECAYS), events.height, events.width), np.float32)
        grid[: self._bins] = self._C * voxel_grid(events, self._bins, normalize=False)
        for k, sums in enumerate(self._sums, start=self._bins):
            grid[k] = sums.image(self._last_us)
        return grid


class OurReconstruction(E2vid):
    """The network on the events of one sensor.

    Parameters
    ----------
    width, height
        Size of the sensor, px.
    contrast_threshold
        C, log units.
    network
        The network with its weights.
    window_us
        Length of the windows, us. They begin at multiples of it, and after images.

    Raises
    ------
    WeightsError
        The sensor is too small, or too large for this machine.
    TaskError
        A number is out of range.
    """

    NAME = "our reconstruction"

    def __init__(
        self,
        width: int,
        height: int,
        contrast_threshold: float,
        *,
        network: Network,
        window_us: float = WINDOW_US,
    ) -> None:
        super().__init__(width, height, contrast_threshold, network=network, window_us=window_us)
        self._inputs = InputGrids(width, height, contrast_threshold, network.bins)

    def _grid(self, events: Events) -> NDArray[np.float32]:
        return self._inputs.push(events)
