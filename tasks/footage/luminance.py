"""Linear luminance of images as files store them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor.encoding import to_linear
from sensor.levels import white_level
from tasks.errors import TaskError

_BT709 = np.array([0.2126, 0.7152, 0.0722], np.float32)  # ITU-R BT.709-6, item 3.2


class Luminance:
    """Converts stored numbers to linear luminance.

    Parameters
    ----------
    encoding
        Transfer function of the stored numbers, see `sensor.to_linear`.

    Raises
    ------
    SensorError
        The encoding is unknown.
    """

    def __init__(self, encoding: str) -> None:
        types = np.uint8, np.uint16
        codes = [np.arange(np.iinfo(kind).max + 1, dtype=kind) for kind in types]
        self._light = {code.dtype.name: to_linear(code, encoding) for code in codes}

    def __call__(self, image: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return the luminance of an image.

        Parameters
        ----------
        image
            (H, W) or (H, W, 3) red, green, blue; uint8 or uint16, or floats, which are linear.

        Returns
        -------
        (H, W) float32.
        """
        light = self._light[image.dtype.name][image] if image.dtype.kind == "u" else image
        linear: NDArray[np.float32] = light.astype(np.float32, copy=False)
        return linear if linear.ndim == 2 else linear @ _BT709


def coding_of(
    first: NDArray[np.generic], given: str | None, usual: str, path: Path
) -> tuple[str, float]:
    """Return the encoding of images like the first, and the light of white.

    Returns
    -------
    The encoding, and 1, or for floats the 99.9th percentile of the finite ones of the first image.
    """
    if first.dtype.kind != "f":
        return given or usual, 1.0
    if given not in (None, "linear"):
        raise TaskError(f"{path}: images of floats are linear; leave out --encoding {given}")
    light = Luminance("linear")(first)
    finite = light[np.isfinite(light)]
    white = white_level(finite) if finite.size else 0.0
    if white <= 0:
        raise TaskError(f"{path}: the first frame defines white, but is black or not finite")
    return "linear", white
