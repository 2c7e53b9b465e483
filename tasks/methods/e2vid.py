"""E2VID and FireNet: images from the voxel grids of successive windows, by a recurrent network.

Rebecq, Ranftl, Koltun and Scaramuzza, "High Speed and High Dynamic Range Video with an Event
Camera" (PAMI 2019). The network's memory is all that lasts from one window to the next. Its image
is intensity as on a display, without the original's unsharp mask. FireNet (Scheerlinck et al., WACV
2020) is a smaller network, and FireNet+ (Stoffregen et al., ECCV 2020) the same with other weights.

Windows last a fixed time, or hold a fixed number of events as in the original. With fixed times, an
image ends the current window, so that it includes all events before it, but for those of less than
a hundredth of a window; with fixed numbers, it is that of the latest complete window.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.events import concatenate
from sensor.representations import voxel_grid

WINDOW_US = 25_000.0  # of base time
DARKEST = 1 / 255  # of the displayed intensity, before the logarithm
_MIN_SHARE = 0.01  # of a window: a shorter one is not ended, and its image is the previous one


def even_window_us(step_us: float) -> float:
    """Return the length of windows near `WINDOW_US` of which a whole number fits between images."""
    return step_us / max(1, round(step_us / WINDOW_US))


class Network(Protocol):
    """`tasks.learned.e2vid.E2vidNetwork` or `tasks.learned.firenet.FireNetNetwork`."""

    bins: int
    normalized: bool  # whether the voxel grids are

    def image(self, grid: NDArray[np.float32], states: Any) -> tuple[NDArray[np.float32], Any]:
        """As `E2vidNetwork.image`."""
        ...


class E2vid:
    """E2VID or FireNet on the events of one sensor.

    Windows last `window_us`, and begin at multiples of it and after images; or they have
    `events_per_px` events per pixel, 0.35 in the original.
    """

    def __init__(
        self,
        width: int,
        height: int,
        contrast_threshold: float,
        *,
        network: Network,
        window_us: float = WINDOW_US,
        events_per_px: float | None = None,
    ) -> None:
        self._network, self._window_us = network, window_us
        self._count: int | None = None
        if events_per_px is not None:
            self._count = max(1, math.floor(events_per_px * width * height))
        self._parts: list[Events] = []  # of the window that has not ended
        # Times of windows: the first begins at `_origin_us`, and `_ended` of them have ended.
        self._origin_us: float | None = None
        self._ended = 0
        self._states: Any = None
        self._image: NDArray[np.float64] = np.zeros((height, width))

    def push(self, events: Events) -> None:
        """Take in the next events, and run the network on each window that ends."""
        while len(events) and (before := self._before_end(events)) is not None:
            self._parts.append(events[:before])
            self._end_window()
            events = events[before:]
        self._parts.append(events)

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Return log intensity, (height, width), 0 before the first window has ended."""
        if self._count is None and self._origin_us is not None:
            while self._end_us <= t_us:
                self._end_window()
            if t_us - self._start_us > _MIN_SHARE * self._window_us:
                self._end_window()
                self._origin_us, self._ended = float(t_us), 0
        return self._image

    @property
    def _start_us(self) -> float:
        assert self._origin_us is not None
        return self._origin_us + self._ended * self._window_us

    @property
    def _end_us(self) -> int:
        """End of the current window; its events are earlier."""
        return round(self._start_us + self._window_us)

    def _before_end(self, events: Events) -> int | None:
        """Return how many of the events are in the current window, None if it does not end."""
        if self._count is not None:
            missing = self._count - sum(map(len, self._parts))
            return missing if missing <= len(events) else None
        if self._origin_us is None:
            self._origin_us = int(events.t_us[0]) // self._window_us * self._window_us
        if events.t_us[-1] < self._end_us:
            return None
        return int(np.searchsorted(events.t_us, self._end_us))

    def _end_window(self) -> None:
        events = concatenate(self._parts)
        self._parts = [events[:0].copy()]  # a slice would keep them all
        self._ended += 1
        intensity, self._states = self._network.image(self._grid(events), self._states)
        self._image = np.log(np.maximum(intensity.astype(np.float64), DARKEST))

    def _grid(self, events: Events) -> NDArray[np.float32]:
        """Return the network's input for the events of a window."""
        return voxel_grid(events, self._network.bins, normalize=self._network.normalized)
