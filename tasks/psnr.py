"""The peak signal-to-noise ratio of pictures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError

MAX_PSNR_DB = 100.0
"""PSNR of identical pictures, dB, as of a camera at rest; infinite scores have no differences."""


def psnr_db(prediction: NDArray[np.floating], truth: NDArray[np.floating]) -> float:
    """Return the peak signal-to-noise ratio of two pictures; the peak is 1.

    Parameters
    ----------
    prediction, truth
        (H, W) in [0, 1].

    Returns
    -------
    The ratio, dB, at most `MAX_PSNR_DB`.

    Raises
    ------
    TaskError
        The pictures differ in shape.

    Examples
    --------
    >>> import numpy as np
    >>> from tasks.psnr import psnr_db
    >>> truth = np.full((4, 4), 0.5)
    >>> round(psnr_db(truth + 0.01, truth), 6), psnr_db(truth, truth)
    (40.0, 100.0)
    """
    if prediction.shape != truth.shape:
        raise TaskError(f"prediction: found shape {prediction.shape}, expected {truth.shape}")
    mean_square = float(np.mean(np.square(prediction - truth)))
    if mean_square == 0:
        return MAX_PSNR_DB
    return min(-10.0 * float(np.log10(mean_square)), MAX_PSNR_DB)
