"""Bicubic interpolation with its gradient, jitted, for the photometric methods."""

from __future__ import annotations

import numba


@numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
def sample(image, x_px, y_px):
    """Value and gradient of an image at a point: (value, d/dx, d/dy).

    Catmull-Rom in both directions, so the gradient is continuous; pixel centres are at integers +
    0.5. Beyond the edge the outermost pixels go on.
    """
    height, width = image.shape
    column = x_px - 0.5
    row = y_px - 0.5
    x0 = int(column) if column >= 0 else int(column) - 1
    y0 = int(row) if row >= 0 else int(row) - 1
    fx, fy = column - x0, row - y0
    value, dx, dy = 0.0, 0.0, 0.0
    for j in range(4):
        if j == 0:
            wy = ((-0.5 * fy + 1.0) * fy - 0.5) * fy
            gy = (-1.5 * fy + 2.0) * fy - 0.5
        elif j == 1:
            wy = (1.5 * fy - 2.5) * fy * fy + 1.0
            gy = (4.5 * fy - 5.0) * fy
        elif j == 2:
            wy = ((-1.5 * fy + 2.0) * fy + 0.5) * fy
            gy = (-4.5 * fy + 4.0) * fy + 0.5
        else:
            wy = (0.5 * fy - 0.5) * fy * fy
            gy = (1.5 * fy - 1.0) * fy
        y = min(max(y0 + j - 1, 0), height - 1)
        a = image[y, min(max(x0 - 1, 0), width - 1)]
        b = image[y, min(max(x0, 0), width - 1)]
        c = image[y, min(max(x0 + 1, 0), width - 1)]
        d = image[y, min(max(x0 + 2, 0), width - 1)]
        k1 = 0.5 * (c - a)
        k2 = a - 2.5 * b + 2.0 * c - 0.5 * d
        k3 = 0.5 * (d - a) + 1.5 * (b - c)
        line = ((k3 * fx + k2) * fx + k1) * fx + b
        value += wy * line
        dx += wy * ((3.0 * k3 * fx + 2.0 * k2) * fx + k1)
        dy += gy * line
    return value, dx, dy
