"""Optical flow of patches: the displacement of a feature over a window."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth
from sensor import Events
from tasks.errors import TaskError

PATCH_PX = 61  # side of a patch at the reference width
REFERENCE_WIDTH_PX = 1280  # H_max of the RNEPE
MIN_PATCH_PX = 7
MARGIN_PX = 40  # at the reference width; keeps the relatively largest patch, 7 px of 128, inside
INITIAL_SIGMA_PX = 3.0  # at the reference width
REACH_SIGMAS = 4.0  # of the search of every method, of the initial flow's error along each axis
EVENT_COLUMNS = "x_px", "y_px", "t", "t_before", "p"
"""The fields of a `FlowSample` with a value for each event."""
_PATH_CHECKS = 5  # times within a window at which a feature must be visible


@dataclass(frozen=True, eq=False, slots=True)
class FlowSample:
    """What a flow method may use: the events of one patch over one window.

    Positions are in pixels of the sensor, (0, 0) at its top-left corner and pixel centers at
    integers + 0.5. Times are in windows: 0 at the window's start, 1 at its end.

    Parameters
    ----------
    x_px, y_px
        (N,) float64, center of each event's pixel.
    t
        (N,) float64 in [0, 1), event times, ascending.
    t_before
        (N,) float64, time of the previous event at the pixel in this window, NaN for the first.
    p
        (N,) int8, polarity.
    log_image
        (h, w) float64, L_l: log intensity at the window's start at the sensor's resolution.
    contrast_threshold
        C, known in simulation, log units.
    center_px
        (2,) float64, the feature at the window's start.
    patch
        (2, 2) int64: first column and row of the events' patch, then the column and row after its
        last. It is a square of `patch_px`, cut at the edge of the sensor.
    initial
        (2,) float64, flow from which to start the search, px per window.
    initial_sigma_px
        Standard deviation of the initial flow's error per component, px.
    """

    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    t: NDArray[np.float64]
    t_before: NDArray[np.float64]
    p: NDArray[np.int8]
    log_image: NDArray[np.float64]
    contrast_threshold: float
    center_px: NDArray[np.float64]
    patch: NDArray[np.int64]
    initial: NDArray[np.float64]
    initial_sigma_px: float


@dataclass(frozen=True, eq=False, slots=True)
class FlowEstimate:
    """A method's answer.

    Parameters
    ----------
    flow
        (2,) float64, px per window at the sensor's resolution; the initial flow after a failure.
    failure
        Reason for a failure, or "". Failures are counted, not dropped.
    delay
        Delay of the events, in windows, if the method estimates it.
    """

    flow: NDArray[np.float64]
    failure: str = ""
    delay: float = 0.0


def patch_px(width: int, native: bool = False) -> int:
    """Return the side of a patch: 61 px of a 1280 px image, odd, at least 7.

    Parameters
    ----------
    width
        Width of the sensor, px.
    native
        Keep 61 px for every sensor, as some methods get too few events from 7 px.

    Returns
    -------
    The side, px.

    Examples
    --------
    >>> from tasks.flow import patch_px
    >>> [patch_px(width) for width in (128, 346, 1280)]
    [7, 17, 61]
    """
    side = PATCH_PX if native else round(PATCH_PX * width / REFERENCE_WIDTH_PX)
    return max(MIN_PATCH_PX, side + 1 - side % 2)


def rnepe_px(estimate: NDArray[np.float64], truth: NDArray[np.float64], width: int) -> float:
    """Return the resolution-normalized end-point error, H_max / H |v_hat - v|.

    Parameters
    ----------
    estimate, truth
        (2,) flows, px per window.
    width
        Width of the sensor, px.

    Returns
    -------
    The error, px at 1280 px.

    Examples
    --------
    Half a pixel at 320 px is as far in the view as two pixels at 1280 px:

    >>> import numpy as np
    >>> from tasks.flow import rnepe_px
    >>> rnepe_px(np.array([3.5, 0.0]), np.array([3.0, 0.0]), width=320)
    2.0
    """
    return float(REFERENCE_WIDTH_PX / width * np.linalg.norm(estimate - truth))


@dataclass(frozen=True, eq=False, slots=True)
class Features:
    """Features of one window with their true flow, in pixels of an image of some size.

    Parameters
    ----------
    width, height
        Size of the image, px.
    centers_px
        (N, 2) positions at the window's start.
    flow_px
        (N, 2) true displacements until the window's end.
    draws
        (N, 2) standard normal numbers: the errors of the initial flows, in sigma.
    """

    width: int
    height: int
    centers_px: NDArray[np.float64]
    flow_px: NDArray[np.float64]
    draws: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.centers_px)

    def at(self, width: int, height: int | None = None) -> Features:
        """Return the same features in an image of another size and the same shape, to a pixel.

        The errors of the initial flows scale with the image: all sensors get the same draws.

        Parameters
        ----------
        width
            Width of the image, px.
        height
            Its height, px; by default that of square pixels, rounded.

        Returns
        -------
        Features in pixels of that image.
        """
        if height is None:
            height = round(width * self.height / self.width)
        scale = np.array([width / self.width, height / self.height])
        return Features(width, height, scale * self.centers_px, scale * self.flow_px, self.draws)

    def initial_flow_px(self, sigma_px: float = INITIAL_SIGMA_PX) -> NDArray[np.float64]:
        """Return initial flows, (N, 2): the truth plus Gaussian noise.

        `sigma_px` is the noise's standard deviation per component, px of an image of 1280 px.
        """
        return self.flow_px + initial_sigma_px(self.width, sigma_px) * self.draws


def initial_sigma_px(width: int, sigma_px: float = INITIAL_SIGMA_PX) -> float:
    """Return the standard deviation of the initial flows' errors per component.

    Parameters
    ----------
    width
        Width of the sensor, px.
    sigma_px
        Standard deviation at 1280 px, px.

    Returns
    -------
    The standard deviation at that width, px.
    """
    return sigma_px * width / REFERENCE_WIDTH_PX


def find_features(
    image: NDArray[np.floating],
    truth: GroundTruth,
    window_s: tuple[float, float],
    key: tuple[str, int],
    *,
    count: int = 20,
    seed: int = 0,
) -> Features:
    """Find the strongest corners of an image that stay visible over a window, with their true flow.

    They are found once, in the rendered image, and serve every sensor: see `Features.at`. The flow
    comes from geometry: it is the displacement of the surface point between the window's start and
    end. A corner that is hidden within the window, or leaves the image, is skipped.

    Parameters
    ----------
    image
        (H, W) radiance at the window's start, from the camera of `truth`, at any resolution.
    truth
        Ground truth of the scene.
    window_s
        Start and end, seconds on the path.
    key, seed
        Name of the scene and number of the sample: with the seed and a feature's rank, they
        determine its draws.
    count
        Number of features.

    Returns
    -------
    The features, in pixels of the image.

    Raises
    ------
    TaskError
        The image has fewer such corners.
    """
    height, width = image.shape
    corners_px = corners(image, MARGIN_PX * width / REFERENCE_WIDTH_PX)
    start_s, end_s = window_s
    visible = np.ones(len(corners_px), bool)
    for t_s in np.linspace(start_s, end_s, _PATH_CHECKS + 1)[1:]:
        flow_px, valid = truth.point_flow(corners_px, start_s, t_s, width)
        visible &= valid
    chosen = np.flatnonzero(visible)[:count]
    if len(chosen) < count:
        raise TaskError(
            f"features: {len(chosen)} of {len(corners_px)} corners stay in view from {start_s:g} "
            f"to {end_s:g} s, expected {count}"
        )
    scene, sample = key
    rng = np.random.default_rng([seed, zlib.crc32(scene.encode(errors="surrogatepass")), sample])
    draws = rng.standard_normal((count, 2))
    return Features(width, height, corners_px[chosen], flow_px[chosen], draws)


def corners(image: NDArray[np.floating], margin_px: float) -> NDArray[np.float64]:
    """Return the corners of an image, the strongest first.

    Parameters
    ----------
    image
        (H, W) radiance.
    margin_px
        Least distance from the image's edge.

    Returns
    -------
    (N, 2) positions, px.
    """
    import cv2

    bright = np.clip(image / np.percentile(image, 99.9), 0, 1) ** (1 / 2.2)
    inside = np.zeros(image.shape, np.uint8)
    margin = int(np.ceil(margin_px))
    inside[margin : image.shape[0] - margin, margin : image.shape[1] - margin] = 1
    points = cv2.goodFeaturesToTrack(
        bright.astype(np.float32),
        maxCorners=0,
        qualityLevel=1e-4,
        minDistance=PATCH_PX * image.shape[1] / REFERENCE_WIDTH_PX,
        mask=inside,
        blockSize=7,
    )
    if points is None:
        return np.empty((0, 2))
    return points.reshape(-1, 2).astype(np.float64) + 0.5


def patch(
    center_px: NDArray[np.float64], side_px: int, width: int, height: int
) -> NDArray[np.int64]:
    """Return the patch around a point, cut at the edge of the sensor.

    Parameters
    ----------
    center_px
        (2,) position of the point.
    side_px
        Side of the patch, px.
    width, height
        Size of the sensor, px.

    Returns
    -------
    (2, 2): first column and row, then the column and row after the last.
    """
    first = np.floor(center_px - 0.5 * side_px + 0.5).astype(np.int64)
    return np.clip(np.stack([first, first + side_px]), 0, (width, height))


def patch_mask(
    centers_px: NDArray[np.float64], side_px: int, width: int, height: int
) -> NDArray[np.bool_]:
    """Return the pixels in any of the patches around some points.

    `flow_sample` needs only the events of these pixels, if a stream is too large to keep.

    Parameters
    ----------
    centers_px
        (N, 2) positions of the points.
    side_px
        Side of the patches, px.
    width, height
        Size of the sensor, px.

    Returns
    -------
    (height, width) mask.
    """
    mask = np.zeros((height, width), bool)
    for center_px in centers_px:
        (left, top), (right, bottom) = patch(center_px, side_px, width, height)
        mask[top:bottom, left:right] = True
    return mask


def flow_sample(
    events: Events,
    start_us: int,
    end_us: int,
    log_image: NDArray[np.float64],
    contrast_threshold: float,
    center_px: NDArray[np.float64],
    side_px: int,
    initial: NDArray[np.float64],
    initial_sigma_px: float,
) -> FlowSample:
    """Select the events of one patch and window.

    Parameters
    ----------
    events
        Events, including all of the window in the patch.
    start_us, end_us
        The window, in the events' time.
    log_image
        (h, w) log intensity at the window's start.
    contrast_threshold
        C, log units.
    center_px, side_px
        Center, (2,), and side of the patch, px.
    initial
        (2,) initial flow, px per window.
    initial_sigma_px
        Standard deviation of its error per component, px.

    Returns
    -------
    What a flow method may use.
    """
    window = events.between(start_us, end_us)
    area = patch(center_px, side_px, events.width, events.height)
    (left, top), (right, bottom) = area
    inside = (window.x >= left) & (window.x < right) & (window.y >= top) & (window.y < bottom)
    window = window.where(inside)
    pixel = (window.y.astype(np.int64) - top) * (right - left) + (window.x - left)
    small = np.min_scalar_type((right - left) * (bottom - top))  # numpy sorts 16 bits fastest
    t = (window.t_us - start_us) / (end_us - start_us)
    return FlowSample(
        x_px=window.x.astype(np.float64) + 0.5,
        y_px=window.y.astype(np.float64) + 0.5,
        t=t,
        t_before=times_before(pixel.astype(small), t),
        p=window.p,
        log_image=np.ascontiguousarray(log_image),
        contrast_threshold=contrast_threshold,
        center_px=center_px,
        patch=area,
        initial=initial,
        initial_sigma_px=initial_sigma_px,
    )


def times_before(pixel: NDArray[np.integer], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the time of the previous event at each event's pixel.

    Parameters
    ----------
    pixel
        (N,) index of each event's pixel.
    t
        (N,) event times, ascending.

    Returns
    -------
    (N,) times, NaN for the first event of a pixel.
    """
    order = np.argsort(pixel, kind="stable")
    before = np.full(t.shape, np.nan)
    same = np.diff(pixel[order]) == 0
    before[order[1:][same]] = t[order[:-1][same]]
    return before
