"""Image reconstruction: predict the image at a window's end from its start and its events."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError


@dataclass(frozen=True, eq=False, slots=True)
class ReconstructionSample:
    """What a reconstruction method may use.

    Parameters
    ----------
    log_keyframe
        (H, W) float64, L_0: log intensity at the window's start, at the frames' resolution.
    polarity_sum
        (h, w) float64, sum of polarities per pixel over the window, at the sensor's resolution.
    contrast_threshold
        C, known in simulation, log units.
    """

    log_keyframe: NDArray[np.float64]
    polarity_sum: NDArray[np.float64]
    contrast_threshold: float


Reconstruct = Callable[[ReconstructionSample], NDArray[np.float64]]


def psnr_db(
    log_prediction: NDArray[np.floating], log_truth: NDArray[np.floating], log_white: float
) -> float:
    """Return the peak signal-to-noise ratio of two images that are given as log intensity.

    Both become intensity, `exp`, in units of white, clipped to [0, 1]; the peak is 1.

    Parameters
    ----------
    log_prediction, log_truth
        (H, W), log units.
    log_white
        Log intensity of white.

    Returns
    -------
    The ratio, dB; inf for equal images.

    Raises
    ------
    TaskError
        The images differ in shape.
    """
    if log_prediction.shape != log_truth.shape:
        raise TaskError(
            f"prediction: found shape {log_prediction.shape}, expected {log_truth.shape}"
        )
    prediction, truth = (
        np.minimum(np.exp(image - log_white), 1.0) for image in (log_prediction, log_truth)
    )
    mean_square = float(np.mean(np.square(prediction - truth)))
    return np.inf if mean_square == 0 else -10.0 * float(np.log10(mean_square))


def log_white_level(log_keyframe: NDArray[np.floating]) -> float:
    """Return the log intensity of white: the 99.9th percentile of an image."""
    return float(np.percentile(log_keyframe, 99.9))
