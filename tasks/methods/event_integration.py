"""Event integration (EI), Eq. (8): add the sum of the events to the keyframe."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from tasks.reconstruction import ReconstructionSample

_INTERPOLATION = {
    "nearest": cv2.INTER_NEAREST_EXACT,
    "bilinear": cv2.INTER_LINEAR,
    "bicubic": cv2.INTER_CUBIC,
}


def reconstruct(sample: ReconstructionSample, upsampling: str = "bicubic") -> NDArray[np.float64]:
    """Predict log intensity at the window's end as L_0 + U(sum of p C), Eq. (8).

    Parameters
    ----------
    sample
        The keyframe, and the polarity sums of the window's events at the sensor's resolution.
    upsampling
        U: "nearest", "bilinear" or "bicubic", with pixel centers aligned.

    Returns
    -------
    (H, W) float64, at the keyframe's resolution.
    """
    delta = sample.polarity_sum * sample.contrast_threshold
    height, width = sample.log_keyframe.shape
    up = cv2.resize(delta, (width, height), interpolation=_INTERPOLATION[upsampling])
    return sample.log_keyframe + up


def reconstruct_nearest(sample: ReconstructionSample) -> NDArray[np.float64]:
    """As `reconstruct`, with nearest-neighbor interpolation."""
    return reconstruct(sample, "nearest")


def reconstruct_bilinear(sample: ReconstructionSample) -> NDArray[np.float64]:
    """As `reconstruct`, with bilinear interpolation."""
    return reconstruct(sample, "bilinear")
