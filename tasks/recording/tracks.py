"""Tracks of corners from one frame to the next: the reference for flow if no truth is known.

OpenCV's pyramidal Lucas-Kanade tracker, forward and backward: a corner that does not come back to
its start is left out (Kalal et al., "Forward-Backward Error", ICPR 2010).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

RETURN_PX = 0.2
QUALITY = 0.03  # strength of the weakest corner over the strongest; weaker ones are noise
_APART = 1 / 24  # widths of the frame between two corners
_WINDOW_PX = 21
_LEVELS = 3


@dataclass(frozen=True, eq=False, slots=True)
class Tracks:
    """Corners of a frame, and where they are in the next one.

    Parameters
    ----------
    start_px
        (N, 2) positions in the first frame, the strongest corner first; pixel centers are at
        integers + 0.5.
    flow_px
        (N, 2) displacements.
    """

    start_px: NDArray[np.float64]
    flow_px: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.start_px)

    def distance_px(self, k: int, flow_px: NDArray[np.float64]) -> float:
        """Return how far a flow is from the displacement of a corner."""
        return float(np.linalg.norm(flow_px - self.flow_px[k]))


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


def track(light: NDArray[np.floating], later: NDArray[np.floating], count: int) -> Tracks:
    """Track the strongest corners of a frame.

    Parameters
    ----------
    light, later
        (H, W) light of two frames, in the same unit.

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
