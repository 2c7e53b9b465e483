"""Levels of light: white, and the dark level in relation to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DARK_SHARE = 1e-3
"""Default dark level, share of the white level."""

_SAMPLE_PX = 1 << 14  # of a frame, for a first estimate of the white level
_SAMPLE_SHARE = 0.995


def white_level(frame: NDArray[np.floating]) -> float:
    """Return the white level, `np.percentile(frame, 99.9)`, from the brightest pixels only."""
    values = frame.ravel()
    sample = np.sort(values[:: 1 + values.size // _SAMPLE_PX])
    bright = values[values >= sample[int(_SAMPLE_SHARE * sample.size)]]
    index = (values.size - 1) * (99.9 / 100)
    below = int(index)
    k = below - (values.size - bright.size)
    if k < 0 or k + 1 >= bright.size:
        return float(np.percentile(values, 99.9))
    neighbors = np.partition(bright, (k, k + 1))[k : k + 2]
    return float(np.quantile(neighbors, index - below))
