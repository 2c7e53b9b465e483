"""Radiance to log intensity: Eq. (3) and the dark level."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import allocating, jit, log

# Returned instead of the used size of the pool when radiance is negative or not finite.
BAD = -2


class Light(NamedTuple):
    """The light on the pixels over a chunk of frame intervals."""

    radiance: NDArray[np.floating]  # (F, height * width) linear, at the ends of the intervals
    dark: float  # I_dark


class Overlap(NamedTuple):
    """Overlap of n equal pixels with the samples of a frame along one axis.

    The value of pixel i is `sum(weight[i, j] * sample[first[i] + j] for j in range(samples[i]))`.
    """

    first: NDArray[np.int64]  # (n,)
    samples: NDArray[np.int64]  # (n,)
    weight: NDArray[np.float64]  # (n, max(samples)), each row sums to 1


@allocating
def integrate_area(frame, rows, columns, out):
    """Average the radiance over the area of each pixel: I = k * E, Eq. (3).

    Parameters
    ----------
    frame
        (H, W) linear radiance.
    rows, columns
        `Overlap` of the sensor's rows and columns with those of the frame.
    out
        (height, width) output.

    Returns
    -------
    bool
        True if all radiance is finite and at least 0.
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
def log_intensity(radiance, dark, u):
    """Compute the log intensity u = log(I + I_dark).

    Parameters
    ----------
    radiance
        (n,) linear radiance I.
    dark
        I_dark.
    u
        (n,) output.

    Returns
    -------
    bool
        True if all radiance is finite and at least 0.
    """
    good = True
    for i in range(u.size):
        good &= (radiance[i] >= 0.0) & (radiance[i] < np.inf)
        u[i] = log(radiance[i] + dark)
    return good


@jit
def log_of_flagged(flagged, radiance, dark, light, u):
    """Compute the log intensity of the flagged pixels only.

    Parameters
    ----------
    flagged
        (n,) indices into `radiance`.
    radiance, dark
        As in `log_intensity`.
    light, u
        Scratch memory of at least n entries, and the (n,) output.

    Returns
    -------
    bool
        True if the radiance of all flagged pixels is finite and at least 0.
    """
    for k in range(flagged.size):
        light[k] = radiance[flagged[k]]
    return log_intensity(light[: flagged.size], dark, u)
