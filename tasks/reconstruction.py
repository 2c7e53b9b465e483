"""Image reconstruction: predict the image at a window's end from its start and its events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.psnr import psnr_db as picture_psnr_db


@dataclass(frozen=True, eq=False, slots=True)
class ReconstructionSample:
    """What a reconstruction method may use.

    Parameters
    ----------
    log_keyframe
        (H, W) float64, L_0: log intensity at the window's start, at the frames' resolution.
    polarity_sum
        (h, w) float64, sum of polarities per pixel over the window, at the sensor's resolution. OFF
        events count C_OFF / C_ON, if these differ.
    contrast_threshold
        C of ON events, known in simulation, log units.

    Examples
    --------
    A window in which the left half of the image became brighter by 0.4, two events of 0.2:

    >>> import numpy as np
    >>> from tasks.methods.event_integration import reconstruct
    >>> from tasks.reconstruction import ReconstructionSample
    >>> keyframe = np.zeros((4, 4))
    >>> sums = np.array([[2.0, 0.0], [2.0, 0.0]])
    >>> sample = ReconstructionSample(keyframe, sums, contrast_threshold=0.2)
    >>> reconstruct(sample, upsampling="nearest")[0]
    array([0.4, 0.4, 0. , 0. ])
    """

    log_keyframe: NDArray[np.float64]
    polarity_sum: NDArray[np.float64]
    contrast_threshold: float


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
    The ratio, dB, at most `tasks.psnr.MAX_PSNR_DB`.

    Raises
    ------
    TaskError
        The images differ in shape.

    Examples
    --------
    A prediction that is off by a hundredth of white everywhere:

    >>> import numpy as np
    >>> from tasks.reconstruction import psnr_db
    >>> truth = np.full((4, 4), 0.5)
    >>> round(psnr_db(np.log(truth + 0.01), np.log(truth), log_white=0.0), 6)
    40.0
    """
    prediction, truth = (
        np.minimum(np.exp(image - log_white), 1.0) for image in (log_prediction, log_truth)
    )
    return picture_psnr_db(prediction, truth)


def log_white_level(log_keyframe: NDArray[np.floating]) -> float:
    """Return the log intensity of white: the 99.9th percentile of an image."""
    return float(np.percentile(log_keyframe, 99.9))
