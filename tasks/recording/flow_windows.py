"""Windows of a recording in which flow is scored, and the reference for it.

With frames, a window lasts from one frame to the next, and the reference is the track of each
corner from the first to the second, by OpenCV's pyramidal Lucas-Kanade tracker, forward and
backward: a corner that does not come back to its start is left out (Kalal et al.,
"Forward-Backward Error", ICPR 2010). Without frames there is no reference: the score is how much
sharper the image of the events becomes when they are moved back along the flow, the flow warp loss
of Stoffregen et al., "Reducing the Sim-to-Real Gap for Event Cameras" (ECCV 2020), for the patch
around each corner of that image.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sensor import Events
from sensor.representations import event_counts
from tasks.errors import TaskError
from tasks.evaluation.source import Window
from tasks.flow import REACH_SIGMAS, FlowSample, flow_sample
from tasks.methods.contrast_maximization import Contrast, off_grid
from tasks.recording.frames import RecordedFrames, inside
from tasks.recording.options import FlowOptions
from tasks.recording.recording import Recording

END_POINT_ERROR, CONTRAST_GAIN = "epe_px", "contrast_gain"
"""Metrics: the distance from the corners tracked in the frames; the contrast of the events moved
back along a flow, divided by the contrast of the unmoved events."""

RETURN_PX = 0.2
QUALITY = 0.03  # strength of the weakest corner over the strongest; weaker ones are noise
_APART = 1 / 24  # widths of the frame between two corners
_WINDOW_PX = 21
_LEVELS = 3
_MIN = {"window_ms": 1e-3, "windows": 1, "features": 1, "patch_px": 3, "search_px": 1e-3}


@dataclass(frozen=True, slots=True)
class Start:
    """Patches and search range for flow on a sensor of some width, px."""

    options: FlowOptions
    width: int

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the flow around zero per component, px."""
        return (self.options.search_px or self.width / 16) / REACH_SIGMAS

    @property
    def reach_px(self) -> float:
        """Largest flow along each axis, px."""
        return REACH_SIGMAS * self.sigma_px

    def sample(self, events: Events, window: Window, center_px: NDArray) -> FlowSample:
        """Return the patch around a corner, without an image.

        Parameters
        ----------
        events
            Events, including all of the window.
        window
            The window.
        center_px
            (2,) position of the corner, px.

        Returns
        -------
        FlowSample
        """
        return flow_sample(
            events,
            window.start_us,
            window.end_us,
            log_image=np.broadcast_to(np.nan, (events.height, events.width)),
            contrast_threshold=math.nan,
            center_px=center_px,
            side_px=self.options.patch_px,
            initial=np.zeros(2),
            initial_sigma_px=self.sigma_px,
        )


def check(options: FlowOptions) -> None:
    """Refuse options that are too small.

    Parameters
    ----------
    options
        Windows and patches.

    Raises
    ------
    TaskError
        An option is out of range.
    """
    for name, least in _MIN.items():
        value = getattr(options, name)
        if value is not None and not least <= value < math.inf:
            option = name.replace("_", "-")
            raise TaskError(f"--{option}: found {value:g}, expected at least {least:g}")


def windows_of(
    recording: Recording,
    frames: RecordedFrames | None,
    options: FlowOptions,
    *,
    with_before: bool = False,
) -> list[tuple[Window, int]]:
    """Return windows, spread over a recording, each with the index of the frame at its start.

    Parameters
    ----------
    recording
        The events.
    frames
        Frames of the same camera, if there are any: windows last from one to the next.
    options
        Length and largest number of windows.
    with_before
        Whether each window needs events for its own length before it.

    Returns
    -------
    Windows and indices, 0 without frames.

    Raises
    ------
    TaskError
        An option is out of range, or the recording has no such window.
    """
    check(options)
    if frames is None:
        if options.window_ms is None:
            raise TaskError("give --window-ms or --frames")
        first, length_us = int(with_before), round(1e3 * options.window_ms)
        starts_us = range(recording.start_us, recording.end_us - length_us + 1, length_us)[first:]
        if not starts_us:
            long_ms = (recording.end_us - recording.start_us) / 1000
            least = f"expected at least {first + 1} x {options.window_ms:g} ms (--window-ms)"
            raise TaskError(f"{recording.path}: found {long_ms:g} ms of events, {least}")
        chosen_us = spread(starts_us, options.windows)
        return [(Window(start_us, start_us + length_us), 0) for start_us in chosen_us]
    middle_us = frames.middle_us.tolist()
    windows = [(Window(middle_us[k], middle_us[k + 1]), k) for k in inside(recording, frames)]
    if with_before:
        windows = [each for each in windows if each[0].before_us >= recording.start_us]
        if not windows:
            needed = "dense flow needs events for a window's length before the window"
            raise TaskError(f"{recording.path}: {needed}, but no window between frames has them")
    return [windows[i] for i in spread(range(len(windows)), options.windows)]


def spread(numbers: Sequence[int], most: int) -> list[int]:
    """Choose some numbers, evenly spread.

    Parameters
    ----------
    numbers
        The numbers to choose from.
    most
        Largest number of them.

    Returns
    -------
    list of int

    Examples
    --------
    >>> from tasks.recording.flow_windows import spread
    >>> spread(range(10), 4)
    [1, 3, 6, 8]
    """
    if len(numbers) <= most:
        return list(numbers)
    return [numbers[int((k + 0.5) * len(numbers) / most)] for k in range(most)]


class Sharpness:
    """How much sharper the events around corners become when moved back along a flow."""

    metric = CONTRAST_GAIN

    def __init__(self, window: Window, events: Events, start: Start) -> None:
        self._reach_px = start.reach_px
        self._farthest_px = float(max(events.width, events.height))
        corners_px = event_corners(events)[: start.options.features]
        samples = (start.sample(events, window, corner_px) for corner_px in corners_px)
        self._samples = [sample for sample in samples if len(sample.t)]
        self._gains = [_gain(sample, self._reach_px) for sample in self._samples]
        self.centers_px = np.array([sample.center_px for sample in self._samples]).reshape(-1, 2)

    def value(self, k: int, flow_px: NDArray[np.float64]) -> float:
        """Return the gain of a flow, 1 for zero flow; flow beyond the sensor is cut.

        Parameters
        ----------
        k
            Index of the point.
        flow_px
            (2,) the flow, px per window.

        Returns
        -------
        float
        """
        flow_px = np.clip(flow_px, -self._farthest_px, self._farthest_px)
        reach_px = float(np.abs(flow_px).max())
        if reach_px <= self._reach_px:
            return self._gains[k](flow_px)
        return _gain(self._samples[k], reach_px)(flow_px)


def _gain(sample: FlowSample, reach_px: float) -> Callable[[NDArray[np.float64]], float]:
    """Return the contrast of the events moved back along a flow, relative to zero flow."""
    contrast = Contrast(off_grid(sample), reach_px)
    still = contrast(np.zeros(2))
    return lambda flow_px: contrast(flow_px) / still


def event_corners(events: Events) -> NDArray[np.float64]:
    """Return the corners of the image of events, the strongest first.

    Parameters
    ----------
    events
        Events of one window.

    Returns
    -------
    (N, 2) positions, px.
    """
    image = np.sqrt(event_counts(events).sum(axis=0)).astype(np.float32)
    return strong_corners(np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.float32))


def strong_corners(image: NDArray[np.uint8] | NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the corners of an image of a real camera, the strongest first.

    Parameters
    ----------
    image
        (H, W).

    Returns
    -------
    (N, 2) positions, px.
    """
    corners = cv2.goodFeaturesToTrack(image, 0, QUALITY, _APART * image.shape[1])
    return np.reshape([] if corners is None else corners, (-1, 2)).astype(np.float64) + 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Tracks:
    """Corners of a frame, and where they are in the next one.

    Parameters
    ----------
    centers_px
        (N, 2) positions in the first frame, the strongest corner first; pixel centers are at
        integers + 0.5.
    flow_px
        (N, 2) displacements.
    """

    metric = END_POINT_ERROR
    centers_px: NDArray[np.float64]
    flow_px: NDArray[np.float64]

    def value(self, k: int, flow_px: NDArray[np.float64]) -> float:
        """Return how far a flow is from the displacement of a corner.

        Parameters
        ----------
        k
            Index of the corner.
        flow_px
            (2,) the flow.

        Returns
        -------
        px
        """
        return float(np.linalg.norm(flow_px - self.flow_px[k]))


def track(light: NDArray[np.floating], later: NDArray[np.floating], count: int) -> Tracks:
    """Track the strongest corners of a frame.

    Parameters
    ----------
    light, later
        (H, W) light of two frames, in the same unit.
    count
        Largest number of tracks.

    Returns
    -------
    Tracks
        Tracks of the corners that come back to within 0.2 px of their start.
    """
    white = max(light.max(), later.max(), 1e-30)  # black frames have no corners
    first, second = (np.round(255 / white * image).astype(np.uint8) for image in (light, later))
    start_px = strong_corners(first)
    if not len(start_px):
        return Tracks(start_px, start_px)
    places = (start_px - 0.5).astype(np.float32).reshape(-1, 1, 2)
    moved, is_tracked = _follow(first, second, places)
    back, is_back = _follow(second, first, moved)
    missed = np.linalg.norm((back - places).reshape(-1, 2), axis=1)
    good = np.flatnonzero(is_tracked & is_back & (missed <= RETURN_PX))[:count]
    flow_px = (moved - places).reshape(-1, 2).astype(np.float64)
    return Tracks(start_px[good], flow_px[good])


def _follow(
    image: NDArray[np.uint8], later: NDArray[np.uint8], places: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    size, guess = (_WINDOW_PX, _WINDOW_PX), np.empty(0, np.float32)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        image, later, places, guess, winSize=size, maxLevel=_LEVELS
    )
    return np.asarray(moved, np.float32), np.asarray(status).ravel() == 1
