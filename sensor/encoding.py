"""Images encoded for a screen to linear radiance (`to_linear`), and light back to sRGB."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sensor.errors import SensorError
from sensor.numbers import refusal

Floats = NDArray[np.floating]


def to_linear(frames: ArrayLike, encoding: str) -> NDArray[np.float32]:
    """Convert encoded images to linear radiance for `simulate`, with white at 1.

    Parameters
    ----------
    frames
        An array of any shape, one frame or many: uint8 or uint16, where the largest number of the
        type is white, or floats from 0 to 1. Divide data with fewer bits than their type, such as
        12 bits in a uint16, by their white level first.
    encoding
        Transfer function of the values:

        - "srgb": IEC 61966-2-1, the standard of images and most videos for screens;
        - "rec709": ITU-R BT.709, the transfer function of a video camera;
        - "gamma:2.2", or any other positive number: a power law;
        - "linear": the values are proportional to light.

    Returns
    -------
    float32, in the shape of `frames`.

    Raises
    ------
    SensorError
        The encoding is unknown, or the frames have a wrong type or range.

    Examples
    --------
    Half the code range is far from half the light:

    >>> import numpy as np
    >>> from sensor import to_linear
    >>> image = np.array([0, 128, 188, 255], np.uint8)
    >>> to_linear(image, "srgb").round(2)
    array([0.  , 0.22, 0.5 , 1.  ], dtype=float32)
    """
    decode = _decoder(encoding)
    values = np.asarray(frames)
    if values.dtype.kind == "u" and values.dtype.itemsize <= 2:
        white = np.iinfo(values.dtype).max
        light: NDArray[np.float32] = decode(np.arange(white + 1) / white).astype(np.float32)
        return light[values]
    if values.dtype.kind != "f":
        raise SensorError(
            f"frames: found {values.dtype}, expected uint8, uint16, or floats from 0 to 1"
        )
    outside = values[~((values >= 0) & (values <= 1))]  # NaN fails both comparisons
    if outside.size:
        raise SensorError(
            f"frames: found {outside[0]:g}, expected {values.dtype} values from 0 to 1; divide by "
            "the white level, or pass the integers"
        )
    wide = values.astype(np.result_type(values, np.float32), copy=False)
    return decode(wide).astype(np.float32)


def to_srgb(light: Floats) -> Floats:
    """Encode light in sRGB, IEC 61966-2-1:1999, section 5.2."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def from_srgb(v: Floats) -> Floats:
    """Decode sRGB, IEC 61966-2-1:1999, section 5.2."""
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def _from_rec709(v: Floats) -> Floats:
    """Invert ITU-R BT.709-6, item 1.2; its linear part ends at 4.5 x 0.018."""
    return np.where(v < 0.081, v / 4.5, ((v + 0.099) / 1.099) ** (1 / 0.45))


def _decoder(encoding: str) -> Callable[[Floats], Floats]:
    decoders = {"srgb": from_srgb, "rec709": _from_rec709, "linear": lambda v: v}
    if isinstance(encoding, str) and encoding in decoders:
        return decoders[encoding]
    kind, _, number = str(encoding).partition(":")
    try:
        gamma = float(number)
    except ValueError:
        gamma = math.nan
    if kind != "gamma" or not 0 < gamma < math.inf:
        expected = "'srgb', 'rec709', 'gamma:2.2' (or another positive number), or 'linear'"
        raise refusal("encoding", encoding, expected)
    return lambda v: v**gamma
