"""Bicubic interpolation with its gradient, jitted, for the photometric methods."""

from __future__ import annotations

import numpy as np

from tasks.numerics.compiling import jit_contract

_TOGETHER = 64  # points at a time, so that their pixels stay in the L1 cache


@jit_contract
def sample_all(image, x_px, y_px, out):
    """Interpolate an image (H, W) and its gradient at (N,) points, by Catmull-Rom in both axes.

    Pixel centers are at integers + 0.5, and the gradient is continuous. Outside the image, the
    outermost pixels are repeated. `out` (3, N) gets the value, d/dx and d/dy. Pixels are read
    before the arithmetic, which is then vectorized.
    """
    pixels, f = np.empty((16, _TOGETHER)), np.empty((2, _TOGETHER))
    for start in range(0, x_px.size, _TOGETHER):
        these = slice(start, min(start + _TOGETHER, x_px.size))
        _read(image, x_px[these], y_px[these], pixels, f)
        _interpolate(pixels, f, out[0, these], out[1, these], out[2, these])


@jit_contract
def _read(image, x_px, y_px, pixels, f):
    """Write the 16 pixels around each point, row by row, and its fractional position, (2, N)."""
    height, width = image.shape
    flat = image.ravel()
    first = np.empty(_TOGETHER, np.int64)
    outside = 0
    for k in range(x_px.size):
        column, row = np.floor(x_px[k] - 0.5), np.floor(y_px[k] - 0.5)
        f[0, k], f[1, k] = x_px[k] - 0.5 - column, y_px[k] - 0.5 - row
        first[k] = np.int64(row - 1.0) * width + np.int64(column - 1.0)
        outside += (column < 1.0) | (column >= width - 2) | (row < 1.0) | (row >= height - 2)
    if outside == 0:
        for k in range(x_px.size):
            for j in range(4):
                corner = np.uint64(first[k] + j * width)
                for i in range(4):
                    pixels[4 * j + i, k] = flat[corner + np.uint64(i)]
        return
    for k in range(x_px.size):
        column, row = int(np.floor(x_px[k] - 0.5)), int(np.floor(y_px[k] - 0.5))
        for j in range(4):
            y = min(max(row + j - 1, 0), height - 1)
            for i in range(4):
                pixels[4 * j + i, k] = image[y, min(max(column + i - 1, 0), width - 1)]


@jit_contract
def _interpolate(pixels, f, value, dx, dy):
    """Write the values and gradients from the 16 pixels around each point."""
    for k in range(value.size):
        wx, gx = _weights(f[0, k]), _slopes(f[0, k])
        wy0, wy1, wy2, wy3 = _weights(f[1, k])
        gy0, gy1, gy2, gy3 = _slopes(f[1, k])
        value0, dx0 = _line(pixels[0, k], pixels[1, k], pixels[2, k], pixels[3, k], wx, gx)
        value1, dx1 = _line(pixels[4, k], pixels[5, k], pixels[6, k], pixels[7, k], wx, gx)
        value2, dx2 = _line(pixels[8, k], pixels[9, k], pixels[10, k], pixels[11, k], wx, gx)
        value3, dx3 = _line(pixels[12, k], pixels[13, k], pixels[14, k], pixels[15, k], wx, gx)
        value[k] = wy0 * value0 + wy1 * value1 + wy2 * value2 + wy3 * value3
        dx[k] = wy0 * dx0 + wy1 * dx1 + wy2 * dx2 + wy3 * dx3
        dy[k] = gy0 * value0 + gy1 * value1 + gy2 * value2 + gy3 * value3


@jit_contract
def _line(a, b, c, d, w, g):
    """Return the weighted sum of four pixels in a line, and its derivative."""
    value = a * w[0] + b * w[1] + c * w[2] + d * w[3]
    return value, a * g[0] + b * g[1] + c * g[2] + d * g[3]


@jit_contract
def _weights(f):
    """Return Catmull-Rom weights of the four pixels around a point, f beyond the second."""
    return (
        ((-0.5 * f + 1.0) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((-1.5 * f + 2.0) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    )


@jit_contract
def _slopes(f):
    """Return the derivatives of the weights."""
    return (
        (-1.5 * f + 2.0) * f - 0.5,
        (4.5 * f - 5.0) * f,
        (-4.5 * f + 4.0) * f + 0.5,
        (1.5 * f - 1.0) * f,
    )
