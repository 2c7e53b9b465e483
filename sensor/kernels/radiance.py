"""From radiance to log intensity: Eq. (3) and the dark level."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import jit, log

# In place of how much of the pool is used: there is radiance that is negative or not finite.
BAD = -2


class Light(NamedTuple):
    """What the pixels see over a chunk of frame intervals."""

    radiance: NDArray[np.floating]  # (F, height * width) linear radiance at the intervals' ends
    dark: float  # I_dark


class Overlap(NamedTuple):
    """Overlap of n equal pixels with the samples along one axis.

    Pixel i is `sum(weight[i, j] * sample[first[i] + j] for j in range(samples[i]))`.
    """

    first: NDArray[np.int64]  # (n,)
    samples: NDArray[np.int64]  # (n,)
    weight: NDArray[np.float64]  # (n, most samples) rows sum to 1


@jit
def integrate_area(
    frame,  # (H, W)
    rows,  # Overlap of the sensor's rows with the frame's
    columns,
    out,  # (height, width) out
):
    """I = k * E, Eq. (3): the mean over each pixel's area, rows first.

    Returns whether all radiance is finite and at least 0.
    """
    good = True
    height, width = out.shape
    line = np.empty(frame.shape[1])
    for y in range(height):
        line[:] = 0.0
        for j in range(rows.samples[y]):
            weight = rows.weight[y, j]
            source = frame[rows.first[y] + j]
            for x in range(line.size):
                good &= (source[x] >= 0.0) & (source[x] < np.inf)
                line[x] += weight * source[x]
        for x in range(width):
            total = 0.0
            for j in range(columns.samples[x]):
                total += columns.weight[x, j] * line[columns.first[x] + j]
            out[y, x] = total
    return good


@jit
def log_intensity(
    radiance,  # (n,) linear radiance
    dark,  # I_dark
    u,  # (n,) out
):
    """u = log(I + I_dark). Returns whether all radiance is finite and at least 0."""
    good = True
    for i in range(u.size):
        good &= (radiance[i] >= 0.0) & (radiance[i] < np.inf)
        u[i] = log(radiance[i] + dark)
    return good


@jit
def log_of_flagged(flagged, radiance, dark, light, u):
    """u = log(I + I_dark) of the flagged pixels. Returns whether their radiance is radiance."""
    for k in range(flagged.size):
        light[k] = radiance[flagged[k]]
    return log_intensity(light[: flagged.size], dark, u)
