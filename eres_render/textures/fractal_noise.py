"""Random fields with detail at every scale, from which all textures are made."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]


def fractal_noise(
    shape: tuple[int, int],
    coarsest_px: float,
    finest_px: float,
    rng: np.random.Generator,
    *,
    stretch: float = 1.0,
    fall: float = 1.0,
) -> Float32:
    """Return noise of unit variance with a share in every octave of scale, as 1/f noise has.

    Blobs are `coarsest_px` to about `finest_px` texels large. `fall` is the amplitude of an octave
    relative to the next coarser octave; 1 is 1/f noise.
    """
    import cv2

    height, width = shape
    total = np.zeros(shape, dtype=np.float32)
    size_px, amplitude, variance = float(max(coarsest_px, finest_px)), 1.0, 0.0
    while size_px >= finest_px:
        rows = max(2, round(height / (size_px * stretch)))
        columns = max(2, round(width / size_px))
        octave = rng.standard_normal((min(rows, height), min(columns, width)), dtype=np.float32)
        blobs = cv2.resize(octave, (width, height), interpolation=cv2.INTER_CUBIC)
        total += np.float32(amplitude) * blobs
        variance += amplitude**2 * 0.55  # a cubic blend keeps 0.55 of the variance
        size_px, amplitude = size_px / 2, amplitude * fall
    total /= np.float32(np.sqrt(variance))
    return total
