"""The do-nothing baseline of reconstruction: the keyframe itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.reconstruction import ReconstructionSample


def reconstruct(sample: ReconstructionSample) -> NDArray[np.float64]:
    """Return the keyframe's log intensity, (H, W) float64."""
    return sample.log_keyframe
