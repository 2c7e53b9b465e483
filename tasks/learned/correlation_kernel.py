"""The kernel that looks up a correlation where no gradients are needed."""

from __future__ import annotations

import math

import numpy as np

from sensor.compiling import compiler

RADIUS = 4
SIDE = 2 * RADIUS + 2  # cells that interpolation reads along each axis


@compiler(fastmath={"contract", "reassoc"}, _nrt=False)
def look_up(first, last, old, new, scale, places, products, out):
    """Look up the correlations of some rows of old cells at one resolution.

    The 81 places around a cell are one cell apart, so they share 10 x 10 inner products.

    Parameters
    ----------
    old
        (h, w, channels) float32 features.
    new
        (h', w', channels) float32 features, each the mean of `1 / scale` cells along each axis.
    places
        (2, h, w) float32, x first, in cells of `old`; integers are centers.
    products
        (10, 10) float32, overwritten.
    out
        (h, w, 81) float32, written: column by column of the offsets from -4 to 4, interpolated
        bilinearly, 0 outside the image and at places that are not finite.
    """
    height, width, channels = new.shape
    for i in range(first, last):
        for j in range(old.shape[1]):
            x, y = scale * places[0, i, j] - RADIUS, scale * places[1, i, j] - RADIUS
            around = out[i, j]
            if not (-SIDE < x < width and -SIDE < y < height):
                around[:] = 0.0
                continue
            left, top = math.floor(x), math.floor(y)
            for row in range(SIDE):
                for column in range(SIDE):
                    total = np.float32(0.0)
                    if 0 <= top + row < height and 0 <= left + column < width:
                        for c in range(channels):
                            total += old[i, j, c] * new[top + row, left + column, c]
                    products[row, column] = total
            right, down = np.float32(x - left), np.float32(y - top)
            for column in range(SIDE - 1):
                for row in range(SIDE - 1):
                    near, far = products[row], products[row + 1]
                    upper = near[column] + right * (near[column + 1] - near[column])
                    lower = far[column] + right * (far[column + 1] - far[column])
                    around[(SIDE - 1) * column + row] = upper + down * (lower - upper)
