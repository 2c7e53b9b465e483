"""Voxel grids: polarities, spread over bins of time."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sensor.errors import EventError
from sensor.events import Columns, Events
from sensor.representations.compiling import jit


def voxel_grid(
    events: Events,
    bins: int,
    *,
    convention: Literal["e2vid", "eraft"] = "e2vid",
    positions: NDArray[np.floating] | None = None,
    normalize: bool = True,
) -> NDArray[np.float32]:
    """Return the voxel grid of a window, in the convention of a network.

    In both conventions the first and last event, not the ends of the window, are at the centers of
    the first and last bin. Each event votes for the two bins around it, weighted by distance. The
    conventions differ in two details:

    ==================  ==============================  =====================================
    convention          "e2vid"                         "eraft" (E-RAFT, DSEC)
    ==================  ==============================  =====================================
    all at one time     votes for the first bin         no votes
    normalization       standard deviation over n       standard deviation over n - 1
    ==================  ==============================  =====================================

    Parameters
    ----------
    events
        Events of the window.
    bins
        Number of bins, at least 2.
    convention
        "e2vid" (Rebecq et al., PAMI 2019) or "eraft" (Gehrig et al., 3DV 2021, and the loader of
        DSEC).
    positions
        (N, 2) columns and rows of the events in fractions of a pixel, such as DSEC's rectified
        positions. The center of the first pixel is (0, 0), so subtract 0.5 from
        `Camera.undistorted_positions`. Each event then also votes for the four pixels around it;
        votes outside the sensor are dropped. None takes the whole pixels of the events.
    normalize
        Whether to bring the nonzero entries to mean 0 and standard deviation 1. If they are all
        equal, only the mean is subtracted.

    Returns
    -------
    grid
        (bins, height, width) float32.

    Raises
    ------
    EventError
        There are fewer than 2 bins, the convention is unknown, or `positions` has a wrong shape.

    Examples
    --------
    An event after a quarter of the window votes with weights 3/4 and 1/4 for the two bins:

    >>> import numpy as np
    >>> from sensor import Events
    >>> from sensor.representations import voxel_grid
    >>> x, y = np.array([[0, 1, 1], [0, 0, 0]], np.uint16)
    >>> p = np.array([1, -1, 1], np.int8)
    >>> events = Events(np.array([0, 250, 1000]), x, y, p, width=2, height=1)
    >>> voxel_grid(events, 2, normalize=False)
    array([[[ 1.  , -0.75]],
    <BLANKLINE>
           [[ 0.  ,  0.75]]], dtype=float32)
    """
    if not isinstance(bins, (int, np.integer)) or bins < 2:
        raise EventError(f"voxel_grid: found {bins} bins, expected a whole number of at least 2")
    if convention not in ("e2vid", "eraft"):
        raise EventError(f"voxel_grid: found {convention=}, expected 'e2vid' or 'eraft'")
    grid = np.zeros((bins, events.height, events.width), np.float32)
    if not len(events):
        return grid
    duration_us = int(events.t_us[-1]) - int(events.t_us[0])
    if duration_us > np.iinfo(np.int64).max:
        raise EventError(f"voxel_grid: events span {duration_us} us, expected at most 2^63 - 1")
    if convention == "eraft" and duration_us == 0:
        return grid
    bins_per_us = (bins - 1) / max(duration_us, 1)
    if positions is None:
        _vote(events.columns, bins_per_us, grid)
    elif positions.shape != (len(events), 2):
        raise EventError(
            f"voxel_grid: found positions of shape {positions.shape}, expected ({len(events)}, 2)"
        )
    else:
        if positions.dtype not in (np.float32, np.float64):  # of the order of this machine's bytes
            positions = positions.astype(np.float64)
        _vote_between_pixels(events.columns, positions, bins_per_us, grid)
    if normalize:
        _normalize(grid.reshape(-1), int(convention == "eraft"))
    return grid


@jit
def _vote(events: Columns, bins_per_us: float, grid: NDArray[np.float32]) -> None:
    bins, height, width = grid.shape
    cells = grid.reshape(-1)
    stride, last = np.uint64(height * width), np.uint64(bins - 1)
    for k in range(events.x.size):
        at = bins_per_us * (events.t_us[k] - events.t_us[0])
        bin_ = min(np.uint64(at), last)
        later = np.float32(at - bin_)
        cell = bin_ * stride + events.y[k] * np.uint64(width) + events.x[k]
        p = np.float32(events.p[k])
        cells[cell] += p * (np.float32(1) - later)
        if bin_ < last:
            cells[cell + stride] += p * later


@jit
def _vote_between_pixels(
    events: Columns, positions: NDArray[np.floating], bins_per_us: float, grid: NDArray[np.float32]
) -> None:
    bins, height, width = grid.shape
    for k in range(events.x.size):
        at = bins_per_us * (events.t_us[k] - events.t_us[0])
        x, y = positions[k, 0], positions[k, 1]
        if not (-1 < x < width and -1 < y < height):
            continue
        bin_, column, row = int(at), math.floor(x), math.floor(y)
        later = np.float32(at - bin_)
        right, down = np.float32(x - column), np.float32(y - row)
        p = np.float32(events.p[k])
        for b in range(bin_, min(bin_ + 2, bins)):
            in_bin = p * (later if b > bin_ else np.float32(1) - later)
            for r in range(max(row, 0), min(row + 2, height)):
                in_row = in_bin * (down if r > row else np.float32(1) - down)
                if column >= 0:
                    grid[b, r, column] += in_row * (np.float32(1) - right)
                if column + 1 < width:
                    grid[b, r, column + 1] += in_row * right


@jit
def _normalize(values: NDArray[np.float32], less: int) -> None:
    """Normalize the values that are not 0; the variance divides by their number minus `less`."""
    count, total, squares = 0, 0.0, 0.0
    for value in values:
        count += value != 0
        total += value
        squares += np.float64(value) * value
    if not count:
        return
    mean = total / count
    variance = max(squares - count * mean * mean, 0.0) / max(count - less, 1)
    scale = 1 / math.sqrt(variance) if variance > 0 else 1.0
    for i in range(values.size):
        if values[i] != 0:
            values[i] = scale * (values[i] - mean)
