"""The lens side of a pixel: radiance integrated exactly over each pixel's area, Eq. (3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.radiance import Overlap, integrate_area


def area_weights(n_in: int, n_out: int, aperture: float = 1.0) -> Overlap:
    """Overlap of n_out equal pixels with n_in equal samples along one axis of the same length.

    Parameters
    ----------
    aperture
        Share of a pixel's length that sees light, in its middle.

    Returns
    -------
    first, count, weight
        (n_out,), (n_out,), (n_out, max count): output pixel i is
        `sum(weight[i, j] * sample[first[i] + j] for j in range(count[i]))`. Each row of weights
        sums to 1, and fractional ratios (1280 / 346) are exact to rounding.
    """
    # In units of 1/n_out of a sample all edges are integers, so no overlap is lost to rounding.
    i = np.arange(n_out, dtype=np.int64)
    blind = 0.5 * (1.0 - aperture) * n_in
    left, right = i * n_in + blind, (i + 1) * n_in - blind
    first = np.floor(left / n_out).astype(np.int64)
    count = np.ceil(right / n_out).astype(np.int64) - first
    sample = first[:, None] + np.arange(count.max())
    overlap = np.minimum(right[:, None], (sample + 1) * n_out) - np.maximum(
        left[:, None], sample * n_out
    )
    return Overlap(first, count, np.clip(overlap, 0, None) / (right - left)[:, None])


def integrate(
    frame: NDArray[np.floating],  # (H, W) linear radiance
    height: int,
    width: int,
    fill_factor: float = 1.0,
) -> NDArray[np.float64] | None:
    """Mean radiance over each pixel of a height x width sensor that sees the whole frame.

    The box filter k of Eq. (3), separable, before any logarithm. With a fill factor below 1 only a
    square in each pixel's middle counts, of that share of its area; otherwise the frame's mean is
    conserved.

    Returns
    -------
    (height, width) float64, in the frame's unit; None if the frame holds what is no radiance.
    """
    out = np.empty((height, width))
    aperture = math.sqrt(fill_factor)
    rows = area_weights(frame.shape[0], height, aperture)
    columns = area_weights(frame.shape[1], width, aperture)
    return out if integrate_area(frame, rows, columns, out) else None


def crop_to_aspect(
    height: int, width: int, sensor_height: int, sensor_width: int
) -> tuple[slice, slice]:
    """Rows and columns of the largest middle of a frame that has a sensor's shape, in whole pixels.

    >>> crop_to_aspect(1280, 1280, 720, 1280)
    (slice(280, 1000, None), slice(0, 1280, None))
    """
    seen_height = min(height, round(width * sensor_height / sensor_width))
    seen_width = min(width, round(height * sensor_width / sensor_height))
    top, left = (height - seen_height) // 2, (width - seen_width) // 2
    return slice(top, top + seen_height), slice(left, left + seen_width)
