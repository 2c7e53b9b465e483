"""Contrast maximisation (CM): the flow along which events pile up most sharply.

Gallego, Rebecq and Scaramuzza, "A Unifying Contrast Maximization Framework" (CVPR 2018): events are
moved along the flow to one time, and the image of where they land is sharpest for the true flow.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from tasks.flow import FlowEstimate, FlowSample

MIN_EVENTS = 10
REFERENCE_TIME = 0.5  # mid-window: no event is moved farther than it must
_SMOOTHING_PX = 1.0
_BOUND_SIGMAS = 4.0
_EXPOSURES = 16  # times at which the patch's own motion is sampled


def estimate(sample: FlowSample, objective: str = "variance") -> FlowEstimate:
    """Flow of the greatest contrast of the image of warped events.

    `objective` is "variance", or "gradient" for the mean squared gradient magnitude. No polarity,
    bilinear votes, Gaussian of 1 px. The image is as large as any flow within the
    bound needs, so no vote is ever lost. The search stays within 4 sigma of the initial flow; an
    answer at the bound is reported as a failure, since plain variance can run away on dense
    texture.
    """
    if len(sample.t) < MIN_EVENTS:
        return FlowEstimate(sample.initial, f"{len(sample.t)} events")
    reach = _BOUND_SIGMAS * sample.initial_sigma_px

    def loss(offset: NDArray[np.float64]) -> float:
        if np.abs(offset).max() > reach:
            return 0.0  # worse than any image: a variance is positive
        return -contrast(sample, sample.initial + offset, reach, objective)

    size = max(0.5 * sample.initial_sigma_px, 1e-3)
    simplex = np.array([[0.0, 0.0], [size, 0.0], [0.0, size]])
    best = minimize(
        loss,
        np.zeros(2),
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 2e-3, "fatol": 0.0, "maxfev": 200},
    )
    flow = sample.initial + best.x
    at_bound = np.abs(best.x).max() > 0.98 * reach
    return FlowEstimate(flow, "search ended at its bound" if at_bound else "")


def contrast(
    sample: FlowSample, flow: NDArray[np.float64], reach_px: float, objective: str
) -> float:
    """Contrast of the image of warped events per exposure, relative to its mean squared.

    A patch that stands still sees the points near its edge for part of the window only. So votes
    are divided by the share of the window for which the moving point was in the patch, and points
    seen for less than three quarters of it do not count. Without that, flows that pile up the
    patch's edges score.

    `reach_px` is how far from the initial flow any flow to be compared with this one may be: it
    gives all of them an image of the same size.
    """
    far = np.ceil(0.5 * (np.abs(sample.initial) + reach_px) + 4 * _SMOOTHING_PX).astype(int) + 1
    side = sample.patch_px
    origin = np.floor(sample.centre_px - 0.5 * side + 0.5) - far
    votes = np.zeros((side + 2 * far[1] + 2, side + 2 * far[0] + 2))
    _vote(sample.x_px - origin[0], sample.y_px - origin[1], sample.t, flow, votes)
    exposure = np.zeros_like(votes)
    row, column = (axis.ravel() + 0.5 for axis in np.mgrid[:side, :side])
    for t in (np.arange(_EXPOSURES) + 0.5) / _EXPOSURES:
        _vote(column + far[0], row + far[1], np.full(side**2, t), flow, exposure)
    votes, exposure = (
        cv2.GaussianBlur(image, (0, 0), _SMOOTHING_PX) for image in (votes, exposure)
    )
    seen = exposure > 0.75 * _EXPOSURES
    if seen.sum() < 0.1 * side**2:
        return 0.0  # the patch moves by more than its size: nothing is seen for long
    density = np.divide(votes, exposure, out=np.zeros_like(votes), where=seen)
    mean = density[seen].mean()
    if objective == "variance":
        return float(density[seen].var() / mean**2)
    inner = cv2.erode(seen.astype(np.uint8), np.ones((3, 3))).astype(bool)
    rise_x, rise_y = cv2.Sobel(density, -1, 1, 0), cv2.Sobel(density, -1, 0, 1)
    return float(np.mean(rise_x[inner] ** 2 + rise_y[inner] ** 2) / mean**2)


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def _vote(x_px, y_px, t, flow, image):
    """Add each event, moved to the reference time, to the four pixels around it."""
    for k in range(t.size):
        shift = t[k] - REFERENCE_TIME
        column = x_px[k] - flow[0] * shift - 0.5
        row = y_px[k] - flow[1] * shift - 0.5
        x0, y0 = int(column), int(row)
        fx, fy = column - x0, row - y0
        image[y0, x0] += (1.0 - fx) * (1.0 - fy)
        image[y0, x0 + 1] += fx * (1.0 - fy)
        image[y0 + 1, x0] += (1.0 - fx) * fy
        image[y0 + 1, x0 + 1] += fx * fy
