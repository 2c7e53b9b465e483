"""The second form of the lag law: the error at each width, from one image of the scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor.levels import DARK_SHARE, white_level
from tasks.errors import TaskError
from tasks.footage.images import read_images
from tasks.footage.luminance import Luminance, coding_of

Floats = NDArray[np.floating]

DIRECTIONS_DEG = 0.0, 45.0, 90.0, 135.0
"""Directions of motion whose mean squared errors are averaged if none is given."""

_CUBIC = -0.75  # of OpenCV's cubic enlargement, which event integration uses
_TAPER = 8  # of a side of the image, at each of its ends
_TEXTURE_PX = 1280
_SAMPLES = 128  # of a row of the image
_BINS_PX = 8192  # frequencies along the motion, cycles per so many px


def read_picture(file: str | Path, width: int) -> Floats:
    """Read an image of a scene as a sensor without noise would see it.

    Parameters
    ----------
    file
        PNG, JPEG or TIFF, whose integers are read as sRGB, or floats, also of OpenEXR, which are
        linear.
    width
        Width, px, to which pixels are averaged over their area.

    Returns
    -------
    (H, W) linear, in units of white, 0 to 1.

    Raises
    ------
    TaskError
        The file is no image, is narrower than `width`, or has pixels that hold no light.
    """
    file = Path(file)
    coded = next(read_images([file]))
    encoding, white = coding_of(coded, None, "srgb", file)
    rows, columns = coded.shape[:2]
    if columns < width:
        raise TaskError(
            f"{file}: is {columns} px wide; give an image of at least {width} px, the finest width"
        )
    light = Luminance(encoding, white)(file, coded).astype(np.float64)
    averaged = _averaged(light, round(rows * width / columns), width)
    return np.minimum(averaged / white_level(averaged), 1.0)


@cache
def texture(width: int, height: int) -> Floats:
    """Return a random texture that stands for a scene of which there is no image.

    Its power falls as k^-2.2 in all directions, and the logarithm of its light has a standard
    deviation of 0.65, between those of the packaged scenes, 0.5 to 0.8.

    Parameters
    ----------
    width, height
        Size, px.

    Returns
    -------
    (H, W) linear, in units of white, 0 to 1.
    """
    side = min(max(width, height), _TEXTURE_PX)
    noise = np.fft.rfft2(np.random.default_rng(0).normal(size=(side, side)))
    k = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.rfftfreq(side))
    k[0, 0] = math.inf
    detail = np.fft.irfft2(noise * k**-1.1 * (k < 0.5), (side, side))
    light = np.exp(0.65 * detail / detail.std())
    light = np.minimum(light / white_level(light), 1.0)
    tiles = math.ceil(height / side), math.ceil(width / side)
    return np.tile(light, tiles)[:height, :width]


def _averaged(image: Floats, height: int, width: int) -> Floats:
    """Return an image that is averaged to fewer equal pixels."""
    for count in (width, height):
        samples = image.shape[1]
        sums = np.pad(np.cumsum(image, axis=1), ((0, 0), (1, 0)))
        edges = np.linspace(0, samples, count + 1)
        whole = np.minimum(edges.astype(int), samples - 1)
        parts = np.diff(sums[:, whole] + (edges - whole) * image[:, whole], axis=1)
        image = (parts * (count / samples)).T
    return image


class MovingImage:
    """An image that moves past sensors of several widths.

    A detail of k cycles/px along the motion passes pixels that answer it by H. Their memory, the
    level of the last event, follows by H M: it stays behind by up to half a threshold, which acts
    as one more pole, and is rounded to the threshold. Sampling and enlarging a coarse image passes
    the detail by a, and adds its aliases. docs/lag_tests.md derives the error that remains.

    Parameters
    ----------
    image
        (H, W) linear, in units of white, 0 to 1. Its pixels are those of the finest sensor.
    path_px
        How far it moves within the window, px.
    direction_deg
        Where it moves, degrees: 0 along rows, 90 along columns. None: mean of the squared errors
        of `DIRECTIONS_DEG`.

    Examples
    --------
    Stripes of 8 px. Without lag the finest sensor shows them best, and with much lag the coarsest:

    >>> import numpy as np
    >>> from tasks.advice.spectrum import MovingImage
    >>> image = np.tile(0.5 + 0.2 * np.sin(np.arange(256) * np.pi / 4), (256, 1))
    >>> moving = MovingImage(image, path_px=20, direction_deg=0)
    >>> [int(np.argmax([moving.psnr_db(w, [lag])[0] for w in (64, 256)])) for lag in (0.0, 4.0)]
    [1, 0]
    """

    def __init__(self, image: Floats, path_px: float, direction_deg: float | None = None) -> None:
        height, self._width = image.shape
        window = np.outer(_taper(height), _taper(self._width))
        changing = window * (image - np.average(image, weights=window))
        power = np.abs(np.fft.rfft2(changing)) ** 2 / (np.sum(window**2) * image.size)
        power[:, 1 : (self._width + 1) // 2] *= 2  # of the half that rfft2 leaves out
        self._image, self._power, self._path_px = image, power, path_px
        self._axes = np.fft.fftfreq(height), np.fft.rfftfreq(self._width)
        ky, kx = self._axes[0][:, None], self._axes[1]
        self._motions = []
        for degrees in DIRECTIONS_DEG if direction_deg is None else (direction_deg,):
            angle = math.radians(degrees)
            along = np.abs(kx * math.cos(angle) + ky * math.sin(angle))
            bins = np.rint(_BINS_PX * along).astype(np.int32).ravel()
            change = power * (2 - 2 * np.cos(2 * np.pi * path_px * along))
            self._motions.append((angle, bins, change))

    def psnr_db(
        self, width: int, lags_px: Sequence[float], threshold: float = 0.2, poles: int = 2
    ) -> list[float]:
        """Return the PSNR of event integration, as predicted.

        Parameters
        ----------
        width
            Width of the sensor, px, at most that of the image.
        lags_px
            Delays of all its poles together, in px of the image.
        threshold
            Contrast threshold, log units.
        poles
            Number of poles of its photoreceptor, 1 or 2.

        Returns
        -------
        For each lag, dB.
        """
        (box_y, up_y, all_y, gain_y), (box_x, up_x, all_x, gain_x) = (
            _enlarged(self._width, width, k) for k in self._axes
        )
        box = np.outer(box_y**2, box_x**2)
        whole, crossed = box * np.outer(all_y, all_x), np.outer(box_y * up_y, box_x * up_x)
        image = _averaged(self._image, round(len(self._image) * width / self._width), width)
        errors = np.zeros(len(lags_px))
        for angle, bins, change in self._motions:
            path = self._path_px * width / self._width
            rounding = threshold**2 / 12 * _mean_square(image, path, angle, threshold)
            all_change, own, boxed, passed = (
                np.bincount(bins, weights.ravel())
                for weights in (change, change * whole, self._power * box, change * crossed)
            )
            w = 2j * np.pi / _BINS_PX * np.arange(len(boxed))
            for n, lag in enumerate(lags_px):
                response = 1 / (1 + w * lag / poles) ** poles
                response /= 1 + w * _memory_px(np.abs(response) ** 2 * boxed, w.imag, rounding)
                errors[n] += 2 * rounding * gain_x * gain_y + np.sum(
                    all_change - 2 * response.real * passed + np.abs(response) ** 2 * own
                )
        return [float(value) for value in -10 * np.log10(errors / len(self._motions))]


def _mean_square(image: Floats, path_px: float, angle: float, threshold: float) -> float:
    """Return the mean squared light, 0 at pixels that never fire: they have no events to round."""
    stride = max(1, image.shape[1] // _SAMPLES)
    rows, columns = (np.arange(0, side, stride) for side in image.shape)
    log_light = np.log(image + DARK_SHARE)
    y, x = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
    high = low = log_light[y, x]
    silent = np.arange(len(y))  # so far
    path_px = min(path_px, math.hypot(*image.shape))  # then the image has passed
    last_y, last_x = image.shape[0] - 1, image.shape[1] - 1
    for s in np.linspace(0, path_px, math.ceil(path_px) + 1):
        if not len(silent):
            break
        # Twice as fast as np.clip, on few pixels.
        from_y = np.minimum(np.maximum(np.rint(y - s * math.sin(angle)), 0), last_y).astype(int)
        from_x = np.minimum(np.maximum(np.rint(x - s * math.cos(angle)), 0), last_x).astype(int)
        passed = log_light[from_y, from_x]
        high, low = np.maximum(high, passed), np.minimum(low, passed)
        left = high - low < threshold
        y, x, high, low, silent = (values[left] for values in (y, x, high, low, silent))
    squares = image[np.ix_(rows, columns)] ** 2
    squares.flat[silent] = 0
    return float(np.mean(squares))


def _taper(count: int) -> Floats:
    """Return a window that is flat but for its ends, a raised cosine each."""
    ends = np.minimum(np.arange(count) + 0.5, count - 0.5 - np.arange(count)) * _TAPER / count
    return 0.5 - 0.5 * np.cos(np.pi * np.minimum(ends, 1))


def _enlarged(fine: int, coarse: int, k: Floats) -> tuple[Floats, Floats, Floats, float]:
    """Return what pixels of a coarse sensor, enlarged to a fine sensor, pass along an axis.

    At each `k`, cycles per fine px: the response of a pixel, the response of the enlargement, and
    its power with all aliases; also the gain of the mean square of what differs from pixel to
    pixel.
    """
    pitch = fine / coarse
    box = np.sinc(pitch * k) / np.sinc(k)
    place = (np.arange(fine // math.gcd(fine, coarse)) + 0.5) / pitch - 0.5
    apart = place - np.floor(place) + np.array([1.0, 0.0, -1.0, -2.0])[:, None]  # coarse px
    x, a = np.abs(apart), _CUBIC
    near = ((a + 2) * x - (a + 3)) * x**2 + 1
    far = ((a * x - 5 * a) * x + 8 * a) * x - 4 * a
    weights = np.where(x < 1, near, far)
    waves = np.cos(2 * np.pi * pitch * k[:, None] * apart.ravel())  # places are symmetric
    response = waves @ weights.ravel() / len(place)
    products = [np.sum(weights[: 4 - n] * weights[n:]) / len(place) for n in range(4)]
    power = products[0] + 2 * sum(
        product * np.cos(2 * np.pi * n * pitch * k) for n, product in enumerate(products) if n
    )
    return box, response, power, float(products[0])


def _memory_px(power: Floats, w: Floats, mean_square: float) -> float:
    """Return the length of a pole, px, whose input is ahead of its output by a mean square.

    `power` is the spectrum of the input at each `w`, radians per px.
    """
    low, high = 1e-6, 1e6  # half a thousandth of a mean square is no error; nothing is left
    for _ in range(50):
        middle = math.sqrt(low * high)
        behind = np.sum(power * (w * middle) ** 2 / (1 + (w * middle) ** 2))
        low, high = (middle, high) if behind < mean_square else (low, middle)
    return low
