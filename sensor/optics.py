"""Optics: integrate radiance exactly over the area of each pixel, Eq. (3)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sensor.errors import SensorError
from sensor.kernels.radiance import Overlap, integrate_area
from sensor.model import MIN_FILL_FACTOR
from sensor.numbers import real, whole


def area_weights(n_in: int, n_out: int, aperture: float = 1.0) -> Overlap:
    """Return the overlap of equal pixels with equal samples along one axis of the same length.

    Parameters
    ----------
    n_in, n_out
        Number of samples and of pixels.
    aperture
        Light-sensitive share of the length of a pixel, at its center.

    Returns
    -------
    Overlap
        Exact to rounding, also for fractional ratios (1280 / 346).

    Examples
    --------
    Two pixels over three samples: each sees one and a half.

    >>> from sensor.optics import area_weights
    >>> first, samples, weight = area_weights(3, 2)
    >>> first, samples
    (array([0, 1]), array([2, 2]))
    >>> weight.round(3)
    array([[0.667, 0.333],
           [0.333, 0.667]])
    """
    # In units of 1 / n_out of a sample all edges are integers, so overlaps have no rounding error.
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
    frame: NDArray[np.floating], height: int, width: int, fill_factor: float = 1.0
) -> NDArray[np.float64]:
    """Average radiance over each pixel of a sensor that sees the whole frame.

    Applies the separable box filter k of Eq. (3) before the logarithm. The mean of the frame is
    conserved if the fill factor is 1.

    Parameters
    ----------
    frame
        (H, W) linear radiance.
    height, width
        Size of the sensor, px.
    fill_factor
        Light-sensitive share of the area of a pixel, a square at its center.

    Returns
    -------
    (height, width) float64 in the unit of the frame.

    Raises
    ------
    SensorError
        The size is not positive, the fill factor is out of range, or radiance is negative or not
        finite. Rows of samples that no pixel sees are not checked.

    Examples
    --------
    Four pixels over six columns; the mean stays 1:

    >>> import numpy as np
    >>> from sensor.optics import integrate
    >>> frame = np.array([[0.0, 0.0, 3.0, 3.0, 0.0, 0.0]])
    >>> integrate(frame, height=1, width=4)
    array([[0., 2., 2., 0.]])
    """
    for name, side in (("height", height), ("width", width)):
        whole(name, side, "a positive integer, px", 1)
    expected = f"a share from {MIN_FILL_FACTOR:g} to 1"
    real("fill_factor", fill_factor, expected, MIN_FILL_FACTOR, 1)
    short = frame.dtype.kind == "f" and frame.dtype.itemsize <= 4
    frame = frame.astype(np.float32 if short else np.float64, copy=False)
    out = np.empty((height, width))
    overlaps = pixel_overlaps(frame.shape, height, width, fill_factor)
    if not integrate_area(frame, *overlaps, out):
        raise SensorError("frame: radiance is negative or not finite")
    return out


def pixel_overlaps(
    shape: tuple[int, ...], height: int, width: int, fill_factor: float
) -> tuple[Overlap, Overlap]:
    """Return the overlap of pixels with the samples of a frame, along rows and columns.

    Parameters
    ----------
    shape
        (H, W) of the frame.
    height, width, fill_factor
        As for `integrate`.

    Returns
    -------
    rows, columns
        The arguments of `sensor.kernels.radiance.integrate_area`.

    Examples
    --------
    >>> from sensor.optics import pixel_overlaps
    >>> rows, columns = pixel_overlaps((4, 6), height=2, width=2, fill_factor=1.0)
    >>> rows.samples, columns.samples
    (array([2, 2]), array([3, 3]))
    """
    aperture = math.sqrt(fill_factor)
    sizes = zip(shape, (height, width), strict=True)
    rows, columns = (area_weights(samples, pixels, aperture) for samples, pixels in sizes)
    return rows, columns


def crop_to_aspect(
    height: int, width: int, sensor_height: int, sensor_width: int
) -> tuple[slice, slice]:
    """Return the largest centered crop of a frame with the aspect ratio of a sensor.

    Parameters
    ----------
    height, width
        Size of the frame.
    sensor_height, sensor_width
        Size of the sensor.

    Returns
    -------
    rows, columns
        Slices, whole pixels.

    Examples
    --------
    The rows and columns of a square frame that a sensor of 1280x720 px sees:

    >>> import numpy as np
    >>> from sensor.optics import crop_to_aspect
    >>> rows, columns = crop_to_aspect(1280, 1280, 720, 1280)
    >>> rows, columns
    (slice(280, 1000, None), slice(0, 1280, None))
    >>> np.ones((1280, 1280), np.float32)[rows, columns].shape
    (720, 1280)
    """
    rows = min(height, round(width * sensor_height / sensor_width))
    columns = min(width, round(height * sensor_width / sensor_height))
    top, left = (height - rows) // 2, (width - columns) // 2
    return slice(top, top + rows), slice(left, left + columns)
