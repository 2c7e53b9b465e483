"""The area, colors and file formats that all pictures of a run share."""

from __future__ import annotations

from io import BytesIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

BRIGHTER, DARKER, NONE = (38, 84, 168), (196, 66, 38), (247, 247, 245)  # RGB
MAX_FILM_BYTES = 192_000
_GRAYS = (32, 16, 8, 4, 2, 1)  # levels of the frames in a film; the first that fits is used
_CONTRAST = 0.6  # of the frames in a film: 1 is from black to `NONE`
_SIDE_PX = 320
_VIEW = 0.25  # of the image's width, around its center; at most its height


def central_area(height: int, width: int) -> tuple[int, int, int]:
    """Return the center of an image.

    Parameters
    ----------
    height, width
        Size of the image, px.

    Returns
    -------
    row, column, side
        First row, first column and side, px.
    """
    side = max(2, min(round(width * _VIEW), height))
    return (height - side) // 2, (width - side) // 2, side


def central_crop(image: NDArray) -> NDArray:
    """Return the center of an image, enlarged to a preview by nearest neighbors."""
    y, x, side = central_area(*image.shape)
    k = (np.arange(_SIDE_PX) * side) // _SIDE_PX
    return image[y + k[:, None], x + k]


def png(rgb: NDArray[np.uint8]) -> bytes:
    """Return the bytes of a PNG file."""
    _, data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    return data.tobytes()


def film_strip(lights: NDArray[np.float32], sums: NDArray[np.int16]) -> bytes:
    """Draw the events of a film over its frames.

    Parameters
    ----------
    lights
        (N, side, side) frames, tone-mapped to [0, 1].
    sums
        (N, side, side) sums of polarities: blue if positive, red if negative.

    Returns
    -------
    bytes
        A lossless WebP file with the N pictures side by side. Its frames have the most gray levels
        with which the file has at most `MAX_FILM_BYTES`, or one.
    """
    colors = np.array([DARKER, NONE, BRIGHTER], np.uint8)[np.sign(sums) + 1]
    data = b""
    for levels in _GRAYS:
        dark = np.round((1 - lights) * (levels - 1)) / max(levels - 1, 1)
        pale = np.round(np.array(NONE) * (1 - _CONTRAST * dark[..., None])).astype(np.uint8)
        drawn = np.where(sums[..., None] != 0, colors, pale)
        file = BytesIO()
        Image.fromarray(np.concatenate(drawn, axis=1)).save(file, "WEBP", lossless=True, quality=50)
        data = file.getvalue()
        if len(data) <= MAX_FILM_BYTES:
            break
    return data
