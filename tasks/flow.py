"""Optical flow of patches: how far a feature moves over a window, from the events around it."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth
from sensor import Events
from tasks.errors import TaskError

PATCH_PX = 61  # side of a patch at the reference width
REFERENCE_WIDTH_PX = 1280  # H_max of the RNEPE
MIN_PATCH_PX = 7
MARGIN_PX = 40  # at the reference width: the largest patch, 7 px of 128, stays in the image
INITIAL_SIGMA_PX = 3.0  # at the reference width
_PATH_CHECKS = 5  # times within a window at which a feature must be in sight


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
    patch
        (2, 2) int64: first column and row of the patch that the events were taken from, and those
        after its last. A square of `patch_px`, less what lies outside the sensor.
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
    patch: NDArray[np.int64]
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
    delay
        How late the sensor is, in windows, where the method estimates that.
    """

    flow: NDArray[np.float64]
    failure: str = ""
    delay: float = 0.0


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


@dataclass(frozen=True, eq=False, slots=True)
class Features:
    """Features of one window with their true flow, in pixels of an image of some size.

    Parameters
    ----------
    width, height
        Of the image, px.
    centres_px
        (N, 2) where the features are at the window's start.
    flow_px
        (N, 2) how far they truly move until the window's end.
    draws
        (N, 2) standard normal numbers, by which the initial flows are off.
    """

    width: int
    height: int
    centres_px: NDArray[np.float64]
    flow_px: NDArray[np.float64]
    draws: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.centres_px)

    def at(self, width: int) -> Features:
        """The same features in an image of another width, its height rounded to whole pixels.

        The initial flows are off by the same share of the image: sensors are compared on the same
        draws, not on luck.
        """
        height = round(width * self.height / self.width)
        scale = np.array([width / self.width, height / self.height])
        return Features(width, height, scale * self.centres_px, scale * self.flow_px, self.draws)

    def initial_flow_px(self, sigma_px: float = INITIAL_SIGMA_PX) -> NDArray[np.float64]:
        """Flows to start from, (N, 2): the truth and Gaussian noise.

        `sigma_px` is its standard deviation per component, px of an image of 1280 px.
        """
        return self.flow_px + initial_sigma_px(self.width, sigma_px) * self.draws


def initial_sigma_px(width: int, sigma_px: float = INITIAL_SIGMA_PX) -> float:
    """How far initial flows are off per component at a width, given that at 1280 px."""
    return sigma_px * width / REFERENCE_WIDTH_PX


def find_features(
    image: NDArray[np.floating],  # (H, W) radiance at the window's start
    truth: GroundTruth,
    window_s: tuple[float, float],
    key: tuple[str, int],
    *,
    count: int = 20,
    seed: int = 0,
) -> Features:
    """The strongest corners of an image that stay in sight over a window, with their true flow.

    They are found once, in the rendered image, and serve every sensor: see `Features.at`. The flow
    is from the geometry, where the surface point is at the window's start to where it is at its
    end. A corner that something hides within the window, or that leaves the image, is passed over
    for the next strongest.

    Parameters
    ----------
    image
        Of the camera of `truth`, at any resolution.
    window_s
        Start and end, seconds on the path.
    key, seed
        Name of the scene and number of the sample: the features' draws depend on these and the seed
        alone, a feature's on its rank too.

    Raises
    ------
    TaskError
        The image has fewer such corners.
    """
    height, width = image.shape
    corners_px = corners(image, MARGIN_PX * width / REFERENCE_WIDTH_PX)
    start_s, end_s = window_s
    seen = np.ones(len(corners_px), bool)
    for t_s in np.linspace(start_s, end_s, _PATH_CHECKS + 1)[1:]:
        flow_px, valid = truth.point_flow(corners_px, start_s, t_s, width)
        seen &= valid
    chosen = np.flatnonzero(seen)[:count]
    if len(chosen) < count:
        raise TaskError(
            f"features: found {len(chosen)} of {len(corners_px)} corners that stay in sight over "
            f"the window from {start_s:g} to {end_s:g} s, expected {count}"
        )
    scene, sample = key
    rng = np.random.default_rng([seed, zlib.crc32(scene.encode()), sample])
    draws = rng.standard_normal((count, 2))
    return Features(width, height, corners_px[chosen], flow_px[chosen], draws)


def corners(
    image: NDArray[np.floating],  # (H, W) radiance
    margin_px: float,
) -> NDArray[np.float64]:
    """Corners of an image that are margin_px from its edge, the strongest first, (N, 2) px."""
    bright = np.clip(image / np.percentile(image, 99.9), 0, 1) ** (1 / 2.2)
    inside = np.zeros(image.shape, np.uint8)
    margin = int(np.ceil(margin_px))
    inside[margin : image.shape[0] - margin, margin : image.shape[1] - margin] = 1
    found = cv2.goodFeaturesToTrack(
        bright.astype(np.float32),
        maxCorners=0,
        qualityLevel=1e-4,
        minDistance=PATCH_PX * image.shape[1] / REFERENCE_WIDTH_PX,
        mask=inside,
        blockSize=7,
    )
    if found is None:
        return np.empty((0, 2))
    return found.reshape(-1, 2).astype(np.float64) + 0.5


def patch(
    centre_px: NDArray[np.float64], side_px: int, width: int, height: int
) -> NDArray[np.int64]:
    """The patch around a point, (2, 2): first column and row, and those after the last.

    What lies outside the sensor is cut off.
    """
    first = np.floor(centre_px - 0.5 * side_px + 0.5).astype(np.int64)
    return np.clip(np.stack([first, first + side_px]), 0, (width, height))


def patch_mask(
    centres_px: NDArray[np.float64],  # (N, 2)
    side_px: int,
    width: int,
    height: int,
) -> NDArray[np.bool_]:
    """Pixels that belong to any of the patches around some points, (height, width).

    Of a stream too large to keep, these pixels' events are all that `flow_sample` needs.
    """
    mask = np.zeros((height, width), bool)
    for centre_px in centres_px:
        (left, top), (right, bottom) = patch(centre_px, side_px, width, height)
        mask[top:bottom, left:right] = True
    return mask


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
    area = patch(centre_px, side_px, events.width, events.height)
    (left, top), (right, bottom) = area
    inside = (window.x >= left) & (window.x < right) & (window.y >= top) & (window.y < bottom)
    window = window.where(inside)
    t = (window.t_us - start_us) / (end_us - start_us)
    return FlowSample(
        window.x.astype(np.float64) + 0.5,
        window.y.astype(np.float64) + 0.5,
        t,
        times_before(window.y.astype(np.int64) * events.width + window.x, t),
        window.p,
        log_image,
        contrast_threshold,
        centre_px,
        area,
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
