"""The area, colors and file format that all pictures of a run share."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

BRIGHTER, DARKER, NONE = (38, 84, 168), (196, 66, 38), (247, 247, 245)  # RGB
_SIDE_PX = 320
_VIEW = 0.25  # of the image's side, around its center


def central_crop(image: NDArray) -> NDArray:
    """Return the center of an image at the size of a preview; each pixel becomes a square."""
    height, width = image.shape
    side = max(2, round(width * _VIEW))
    y, x = (height - side) // 2, (width - side) // 2
    k = (np.arange(_SIDE_PX) * side) // _SIDE_PX
    return image[y + k[:, None], x + k]


def png(rgb: NDArray[np.uint8]) -> bytes:
    """Return the bytes of a PNG file."""
    _, data = cv2.imencode(".png", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    return data.tobytes()
