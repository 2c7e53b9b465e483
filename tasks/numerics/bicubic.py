"""Bicubic interpolation with its gradient, jitted, for the photometric methods."""

from __future__ import annotations

from tasks.numerics.compiling import jit_contract


@jit_contract
def sample(image, x_px, y_px):
    """Interpolate an image and its gradient at a point.

    Catmull-Rom in both directions, so the gradient is continuous. Beyond the edge the outermost
    pixels continue.

    Parameters
    ----------
    image
        (H, W) float64.
    x_px, y_px
        The point, with pixel centers at integers + 0.5.

    Returns
    -------
    Value, d/dx, d/dy.
    """
    height, width = image.shape
    column = x_px - 0.5
    row = y_px - 0.5
    x0 = int(column) if column >= 0 else int(column) - 1
    y0 = int(row) if row >= 0 else int(row) - 1
    fx, fy = column - x0, row - y0
    wx0, wx1, wx2, wx3 = _weights(fx)
    gx0, gx1, gx2, gx3 = _slopes(fx)
    wy = _weights(fy)
    gy = _slopes(fy)
    value, dx, dy = 0.0, 0.0, 0.0
    xa, xb = min(max(x0 - 1, 0), width - 1), min(max(x0, 0), width - 1)
    xc, xd = min(max(x0 + 1, 0), width - 1), min(max(x0 + 2, 0), width - 1)
    for j in range(4):
        y = min(max(y0 + j - 1, 0), height - 1)
        a, b, c, d = image[y, xa], image[y, xb], image[y, xc], image[y, xd]
        line = a * wx0 + b * wx1 + c * wx2 + d * wx3
        value += wy[j] * line
        dy += gy[j] * line
        dx += wy[j] * (a * gx0 + b * gx1 + c * gx2 + d * gx3)
    return value, dx, dy


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
