"""Contrast Maximization (CM): the flow for which warped events form the sharpest image.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and their image is sharpest for the true flow.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from tasks.flow import FlowEstimate, FlowSample
from tasks.numerics.compiling import jit, jit_contract

MIN_EVENTS = 10
REFERENCE_TIME = 0.5  # mid-window, so that events move as little as possible
_BOUND_SIGMAS = 4.0
_EXPOSURES = 16  # times, at least, at which the patch's own motion is sampled
_SMOOTHING_PX = 1.0
_REACH_PX = 4  # of the Gaussian: four sigma
_TAPS = np.exp(-0.5 * (np.arange(_REACH_PX + 1) / _SMOOTHING_PX) ** 2)
_TAPS /= 2 * _TAPS.sum() - _TAPS[0]
_G0, _G1, _G2, _G3, _G4 = (float(tap) for tap in _TAPS)


def estimate(sample: FlowSample, objective: str = "variance") -> FlowEstimate:
    """Estimate the flow with the greatest contrast of the image of warped events.

    Polarity is not used; votes are bilinear, and the image is smoothed by a Gaussian of 1 px. It is
    large enough for any flow within the bound, so that no vote is lost. The search (Nelder-Mead)
    stays within 4 sigma of the initial flow; an answer at this bound is a failure, since contrast
    can run away on dense texture.

    Parameters
    ----------
    sample
        Events of one patch.
    objective
        "variance", or "gradient" for the mean squared gradient magnitude.

    Returns
    -------
    The flow; the initial flow where the search fails.
    """
    if len(sample.t) < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{len(sample.t)} events")
    reach = _BOUND_SIGMAS * sample.initial_sigma_px
    contrast = Contrast(sample, reach, objective)

    def loss(offset: NDArray[np.float64]) -> float:
        if max(abs(offset[0]), abs(offset[1])) > reach:
            return 0.0  # worse than any image, as squares are positive
        return -contrast(sample.initial + offset)

    size = max(0.5 * sample.initial_sigma_px, 1e-3)
    simplex = np.array([[0.0, 0.0], [size, 0.0], [0.0, size]])
    best = minimize(
        loss,
        np.zeros(2),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 2e-3, "fatol": np.inf, "maxfev": 200},
    )
    if np.abs(best.x).max() > 0.98 * reach:
        return FlowEstimate(sample.initial, "search ended at its bound")
    return FlowEstimate(sample.initial + best.x)


class Contrast:
    """Contrast of the image of warped events: its variance around the image without texture.

    A static patch sees a point near its edge only for a part of the window. So the image of warped
    events fades out at its edges, and the plain variance rewards any flow that moves this edge
    together. Therefore the image of events that are spread evenly over patch and window is
    subtracted before the squares are added up. The sum then gains nothing from patch edges, at
    small or large flows, and the scatter of single events adds the same to it at every flow.

    Parameters
    ----------
    sample
        Events of one patch.
    reach_px
        Largest distance of any flow from the initial flow, per component: all flows then get
        images of the same size.
    objective
        "variance" or "gradient".
    """

    def __init__(self, sample: FlowSample, reach_px: float, objective: str = "variance") -> None:
        farthest = 0.5 * (np.abs(sample.initial) + reach_px)
        self._far = np.ceil(farthest + _REACH_PX).astype(np.int64) + 1
        self._size = sample.patch[1] - sample.patch[0]
        column, row = self._far - sample.patch[0]
        self._events = np.stack(
            [sample.x_px - 0.5 + column, sample.y_px - 0.5 + row, sample.t - REFERENCE_TIME],
            axis=1,
        )
        exposures = max(_EXPOSURES, math.ceil(2 * farthest.max()))  # at most a pixel apart
        self.exposure_t = (np.arange(exposures) + 0.5) / exposures - REFERENCE_TIME
        self._by_gradient = {"variance": False, "gradient": True}[objective]

    def __call__(self, flow: NDArray[np.float64]) -> float:
        """Return the contrast at a flow, (2,) px per window, relative to the mean squared."""
        return _contrast(
            self._events,
            self.exposure_t,
            self._size[0],
            self._size[1],
            self._far[0],
            self._far[1],
            flow[0],
            flow[1],
            self._by_gradient,
        )


@jit_contract
def _contrast(events, exposure_t, width, height, far_x, far_y, vx, vy, by_gradient):
    """Return the contrast at (vx, vy) of events (N, 3): column, row, and time from mid-window."""
    rows, columns = height + 2 * far_y, width + 2 * far_x
    image = np.zeros((rows, columns))
    for k in range(events.shape[0]):
        column = events[k, 0] - vx * events[k, 2]
        row = events[k, 1] - vy * events[k, 2]
        x0, y0 = int(column), int(row)
        fx, fy = column - x0, row - y0
        image[y0, x0] += (1.0 - fx) * (1.0 - fy)
        image[y0, x0 + 1] += fx * (1.0 - fy)
        image[y0 + 1, x0] += (1.0 - fx) * fy
        image[y0 + 1, x0 + 1] += fx * fy

    # A moving patch with its votes is the product of a moving interval in x and one in y.
    mean = events.shape[0] / (width * height)
    for t in exposure_t:
        along_x = _interval(columns, width, far_x - vx * t)
        along_y = _interval(rows, height, far_y - vy * t)
        for y in range(rows):
            expected = mean / exposure_t.size * along_y[y]
            if expected > 0.0:
                for x in range(columns):
                    image[y, x] -= expected * along_x[x]

    image = _blur(image)
    total = 0.0
    if by_gradient:
        for y in range(1, rows - 1):
            for x in range(1, columns - 1):
                dx = 0.5 * (image[y, x + 1] - image[y, x - 1])
                dy = 0.5 * (image[y + 1, x] - image[y - 1, x])
                total += dx * dx + dy * dy
    else:
        for y in range(rows):
            for x in range(columns):
                total += image[y, x] * image[y, x]
    return total / (width * height * mean * mean)


@jit
def _interval(size, width, first):
    """Return the bilinear votes of `width` pixels in a line, the first at `first`, (size,)."""
    line = np.zeros(size)
    x0 = int(first)
    f = first - x0
    line[x0] = 1.0 - f
    line[x0 + 1 : x0 + width] = 1.0
    line[x0 + width] = f
    return line


@jit_contract
def _blur(image):
    """Blur by a Gaussian of 1 px; the image is empty within its reach of the edge."""
    rows, columns = image.shape
    across = np.zeros((rows, columns))
    for y in range(rows):
        _blur_line(image[y], across[y])
    blurred = np.zeros((rows, columns))
    for y in range(4, rows - 4):
        for x in range(columns):
            blurred[y, x] = (
                _G0 * across[y, x]
                + _G1 * (across[y - 1, x] + across[y + 1, x])
                + _G2 * (across[y - 2, x] + across[y + 2, x])
                + _G3 * (across[y - 3, x] + across[y + 3, x])
                + _G4 * (across[y - 4, x] + across[y + 4, x])
            )
    return blurred


@jit_contract
def _blur_line(line, blurred):
    for x in range(4, line.size - 4):
        blurred[x] = (
            _G0 * line[x]
            + _G1 * (line[x - 1] + line[x + 1])
            + _G2 * (line[x - 2] + line[x + 2])
            + _G3 * (line[x - 3] + line[x + 3])
            + _G4 * (line[x - 4] + line[x + 4])
        )
