"""The area, colors and file formats that all pictures of a run share."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

BRIGHTER, DARKER, NONE = (38, 84, 168), (196, 66, 38), (247, 247, 245)  # RGB
MOST_FILM_BYTES = 96_000
_QUALITIES = (70, 50, 35, 25, 15, 5, 0)  # of a film, the first that fits
_OPACITY = 0.8  # of events over a frame
_SIDE_PX = 320
_VIEW = 0.25  # of the image's side, around its center


def central_area(height: int, width: int) -> tuple[int, int, int]:
    """Return the first row, the first column and the side of the center of an image, px."""
    side = max(2, round(width * _VIEW))
    return (height - side) // 2, (width - side) // 2, side


def central_crop(image: NDArray) -> NDArray:
    """Return the center of an image at the size of a preview; each pixel becomes a square."""
    y, x, side = central_area(*image.shape)
    return scaled(image[y : y + side, x : x + side])


def scaled(center: NDArray) -> NDArray:
    """Return a square image at the size of a preview; each pixel becomes a square."""
    k = (np.arange(_SIDE_PX) * len(center)) // _SIDE_PX
    return center[k[:, None], k]


def drawn_over(ground: NDArray[np.uint8], sums: NDArray[np.int16]) -> NDArray[np.uint8]:
    """Draw the sums of polarities in the center of an image over a picture of the same area.

    Parameters
    ----------
    ground
        (S, S, 3) picture, S the side of a preview.
    sums
        (side, side) sums.

    Returns
    -------
    (S, S, 3), blue where the sum is positive, red where it is negative.
    """
    sign = np.sign(scaled(sums))
    colors = np.array([DARKER, NONE, BRIGHTER])[sign + 1]
    mixed = _OPACITY * colors + (1 - _OPACITY) * ground
    return np.where(sign[..., None] != 0, np.round(mixed).astype(np.uint8), ground)


def png(rgb: NDArray[np.uint8]) -> bytes:
    """Return the bytes of a PNG file."""
    _, data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    return data.tobytes()


def film(pictures: Sequence[NDArray[np.uint8]]) -> bytes:
    """Return the bytes of a WebP file with pictures side by side.

    Its quality is the best at which it has at most `MOST_FILM_BYTES`, or the least of all.
    """
    strip = Image.fromarray(np.concatenate(pictures, axis=1))
    data = b""
    for quality in _QUALITIES:
        file = BytesIO()
        strip.save(file, "WEBP", quality=quality, method=4)
        data = file.getvalue()
        if len(data) <= MOST_FILM_BYTES:
            break
    return data
