"""The do-nothing baseline: the keyframe stands for the image at the window's end."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.reconstruction import ReconstructionSample


def reconstruct(sample: ReconstructionSample) -> NDArray[np.float64]:
    """Log intensity at the window's end, predicted as the keyframe's, (H, W) float64."""
    return sample.log_keyframe
