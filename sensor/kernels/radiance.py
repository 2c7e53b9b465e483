"""Radiance to log intensity: Eq. (3) and the dark level."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import allocating, jit, log

# Returned instead of the used size of the pool when radiance is negative or not finite.
BAD = -2
MIN_LIGHT = float(np.finfo(np.float64).tiny)  # smaller numbers have less precision


class PixelLight(NamedTuple):
    """The light on the pixels over a chunk of frame intervals.

    One of two arrays holds it, and both are read-only, so that kernels are compiled once for frames
    of both types, also for those of a file that is mapped into memory.
    """

    single: NDArray[np.float32]  # (F, height * width) linear radiance at the intervals' ends,
    double: NDArray[np.float64]  # or (0, 0) if the other has it
    dark: float  # I_dark


def light_on_pixels(radiance: NDArray[np.floating], dark: float) -> PixelLight:
    """Return the light on the pixels.

    Parameters
    ----------
    radiance
        (F, height * width) linear radiance, float32 or float64.
    dark
        I_dark.

    Returns
    -------
    PixelLight
    """
    single, double = np.empty((0, 0), np.float32), np.empty((0, 0), np.float64)
    if radiance.dtype == np.float32:
        single = radiance.view()
    else:
        double = radiance.astype(np.float64, copy=False).view()
    single.flags.writeable = double.flags.writeable = False
    return PixelLight(single, double, dark)


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
        True if the radiance of all rows that some pixel sees is finite and at least 0.
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
def log_of_block(light, f, pixels, u):
    """Compute the log intensity of some pixels at a frame.

    Parameters
    ----------
    light, f, pixels
        `PixelLight`, frame of the chunk, and slice of the pixels.
    u
        (n,) output.

    Returns
    -------
    bool
        As for `log_intensity`.
    """
    if light.double.size > 0:
        return log_intensity(light.double[f, pixels], light.dark, u)
    return log_intensity(light.single[f, pixels], light.dark, u)


@jit
def log_of_flagged(flagged, light, f, pixels, room, u):
    """Compute the log intensity of the flagged pixels only.

    Parameters
    ----------
    flagged
        (n,) indices into the pixels.
    light, f, pixels
        As in `log_of_block`.
    room, u
        Scratch memory of at least n entries, and the (n,) output.

    Returns
    -------
    bool
        True if the radiance of all flagged pixels is finite and at least 0.
    """
    if light.double.size > 0:
        take(light.double[f, pixels], flagged, room)
    else:
        take(light.single[f, pixels], flagged, room)
    return log_intensity(room[: flagged.size], light.dark, u)


@jit
def take(radiance, flagged, out):
    """Copy the radiance of the flagged pixels.

    Parameters
    ----------
    radiance, flagged
        (N,) radiance, and (n,) indices into it.
    out
        Output of at least n entries.
    """
    for k in range(flagged.size):
        out[k] = radiance[flagged[k]]
