"""What a square image sees of a periodic texture through a homography."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sensor.compiling import compiler

jit = compiler(Path(__file__).parent)

SUBPIXELS = 2  # samples along each side of a pixel


@jit
def view(
    texture: NDArray[np.float32], homography: NDArray[np.float64], side_px: int
) -> NDArray[np.float32]:
    """Average a texture over each pixel.

    A pixel is the mean of 2 x 2 samples, each interpolated bilinearly. OpenCV's `warpPerspective`
    would round positions to 1/32 px, and motion in such steps causes false events.

    Parameters
    ----------
    texture
        (S, S) linear radiance, periodic; S is a power of two.
    homography
        (3, 3), from pixels to texels, both with centers at integers + 0.5.
    side_px
        Side of the image, px.

    Returns
    -------
    (side_px, side_px) linear radiance.
    """
    last = texture.shape[0] - 1
    image = np.empty((side_px, side_px), np.float32)
    h = homography
    for row in range(side_px):
        for column in range(side_px):
            total = 0.0
            for j in range(SUBPIXELS):
                y = row + (j + 0.5) / SUBPIXELS
                for i in range(SUBPIXELS):
                    x = column + (i + 0.5) / SUBPIXELS
                    scale = 1.0 / (h[2, 0] * x + h[2, 1] * y + h[2, 2])
                    u = scale * (h[0, 0] * x + h[0, 1] * y + h[0, 2]) - 0.5
                    v = scale * (h[1, 0] * x + h[1, 1] * y + h[1, 2]) - 0.5
                    left, top = math.floor(u), math.floor(v)
                    right, down = u - left, v - top
                    c0, c1 = left & last, (left + 1) & last
                    r0, r1 = top & last, (top + 1) & last
                    above = texture[r0, c0] + right * (texture[r0, c1] - texture[r0, c0])
                    below = texture[r1, c0] + right * (texture[r1, c1] - texture[r1, c0])
                    total += above + down * (below - above)
            image[row, column] = total / (SUBPIXELS * SUBPIXELS)
    return image
