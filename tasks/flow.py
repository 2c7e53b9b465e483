"""Optical flow of patches: how far a feature moves over a window, from the events around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.errors import TaskError

PATCH_PX = 61  # side of a patch at the reference width
REFERENCE_WIDTH_PX = 1280  # H_max of the RNEPE
MIN_PATCH_PX = 7


@dataclass(frozen=True, eq=False, slots=True)
class FlowSample:
    """What a flow method may use: the events of one patch over one window.

    Positions are in pixels of the sensor, (0, 0) at its top-left corner and pixel centres at
    integers + 0.5. Times are in windows: 0 at the window's start, 1 at its end.

    Parameters
    ----------
    x_px, y_px
        (N,) float64, centre of each event's pixel.
    t
        (N,) float64 in [0, 1), event times, ascending.
    t_before
        (N,) float64, time of the event before it at its pixel in this window, NaN for the first.
    p
        (N,) int8, polarity.
    log_image
        (h, w) float64, L_l: log intensity at the window's start at the sensor's resolution.
    contrast_threshold
        C, known in simulation.
    centre_px
        (2,) float64, the feature at the window's start.
    patch_px
        Side of the square patch that the events were taken from.
    initial
        (2,) float64, flow to start the search from, px a window.
    initial_sigma_px
        How far, in standard deviations per component, the initial flow may be off.
    """

    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    t: NDArray[np.float64]
    t_before: NDArray[np.float64]
    p: NDArray[np.int8]
    log_image: NDArray[np.float64]
    contrast_threshold: float
    centre_px: NDArray[np.float64]
    patch_px: int
    initial: NDArray[np.float64]
    initial_sigma_px: float


@dataclass(frozen=True, eq=False, slots=True)
class FlowEstimate:
    """A method's answer.

    Parameters
    ----------
    flow
        (2,) float64, px a window at the sensor's resolution.
    failure
        Why there is no answer to trust, or "" where there is one. What failed is counted, not
        dropped: its flow is the initial one.
    """

    flow: NDArray[np.float64]
    failure: str = ""


EstimateFlow = Callable[[FlowSample], FlowEstimate]


def patch_px(width: int, native: bool = False) -> int:
    """Side of the patch for a sensor width: 61 px of a 1280 px image, odd, at least 7.

    `native` keeps 61 px whatever the sensor, since 7 px starve some methods.
    """
    side = PATCH_PX if native else round(PATCH_PX * width / REFERENCE_WIDTH_PX)
    return max(MIN_PATCH_PX, side + 1 - side % 2)


def rnepe_px(estimate: NDArray[np.float64], truth: NDArray[np.float64], width: int) -> float:
    """Resolution-normalised end-point error, H_max / H |v_hat - v|, px at 1280 px."""
    return float(REFERENCE_WIDTH_PX / width * np.linalg.norm(estimate - truth))


def features_px(
    image: NDArray[np.floating],  # (H, W) radiance
    count: int,
    margin_px: float,
) -> NDArray[np.float64]:
    """The strongest corners of an image that are margin_px from its edge, (count, 2) px.

    Raises
    ------
    TaskError
        The image has fewer corners.
    """
    bright = np.clip(image / np.percentile(image, 99.9), 0, 1) ** (1 / 2.2)
    inside = np.zeros(image.shape, np.uint8)
    margin = int(np.ceil(margin_px))
    inside[margin : image.shape[0] - margin, margin : image.shape[1] - margin] = 1
    corners = cv2.goodFeaturesToTrack(
        bright.astype(np.float32),
        count,
        qualityLevel=1e-4,
        minDistance=PATCH_PX * image.shape[1] / REFERENCE_WIDTH_PX,
        mask=inside,
        blockSize=7,
    )
    found = 0 if corners is None else len(corners)
    if found < count:
        raise TaskError(f"features: found {found} corners in the image, expected {count}")
    return corners.reshape(-1, 2).astype(np.float64) + 0.5


def flow_sample(
    events: Events,
    start_us: int,
    end_us: int,
    log_image: NDArray[np.float64],
    contrast_threshold: float,
    centre_px: NDArray[np.float64],
    side_px: int,
    initial: NDArray[np.float64],
    initial_sigma_px: float,
) -> FlowSample:
    """Cut the events of one patch and window out of a stream that has them all."""
    window = events.between(start_us, end_us)
    first_x, first_y = np.floor(centre_px - 0.5 * side_px + 0.5).astype(int)
    x, y = window.x.astype(np.int64) - first_x, window.y.astype(np.int64) - first_y
    inside = (x >= 0) & (x < side_px) & (y >= 0) & (y < side_px)
    t = (window.t_us[inside] - start_us) / (end_us - start_us)
    return FlowSample(
        window.x[inside] + 0.5,
        window.y[inside] + 0.5,
        t,
        times_before(y[inside] * side_px + x[inside], t),
        window.p[inside],
        log_image,
        contrast_threshold,
        centre_px,
        side_px,
        initial,
        initial_sigma_px,
    )


def times_before(pixel: NDArray[np.int64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time of the event before each at its pixel, NaN for a pixel's first; t is ascending."""
    order = np.argsort(pixel, kind="stable")
    before = np.full(t.shape, np.nan)
    same = np.diff(pixel[order]) == 0
    before[order[1:][same]] = t[order[:-1][same]]
    return before
