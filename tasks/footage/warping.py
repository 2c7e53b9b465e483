"""The kernels of frames in between, which sample both images at exact positions along the flow.

Images are interpolated by cubic O-MOMS, the splines with 4 x 4 coefficients around a point that
approximate best (Blu, Thevenaz and Unser, IEEE Transactions on Image Processing 10(7), 2001).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import solve_banded

from sensor.compiling import compiler

_MARGIN = (1, 2), (1, 2)  # of coefficients, so that all that a sample needs is there
_TOGETHER = 64  # pixels at a time, so that their weights stay in the L1 cache
_ROUNDS = 2  # an even number: where something is hidden, odd ones look along the wrong flow

jit = compiler(Path(__file__).parent, fastmath={"contract"})


def coefficients(image):
    """Return the coefficients, (H + 3, W + 3), of the spline through an image, (H, W) float32."""
    for _ in range(2):
        if len(image) > 1:
            bands = np.full((3, len(image)), 4 / 21, np.float32)
            bands[1] = 13 / 21
            bands[0, 1] = bands[2, -2] = 8 / 21  # mirrored at the border
            image = solve_banded((1, 1), bands, image, check_finite=False)
        image = image.T
    return np.pad(image, _MARGIN, mode="reflect")


@jit
def blend(first, second, flow, later, t, start, out):
    """Write the rows from `start` on of the frame at time t, between frames at 0 and 1.

    The flow at that time is between the flows of the points that a pixel sees in the first and in
    the second frame (Super SloMo; Jiang et al., CVPR 2018, Eq. 4). Along it, both frames are moved
    to the time, and blended by how near they are. `first` and `second` are as from `coefficients`,
    `later` as from `find_later`, and `flow`, (H, W, 2) float32 px, x first, displaces points of the
    first frame.
    """
    t = np.float32(t)
    rest = np.float32(1) - t
    at = np.empty(_TOGETHER, np.int32)
    fractions = np.empty((2, _TOGETHER), np.float32)
    weights = np.empty((2, 4, _TOGETHER), np.float32)
    values = np.empty((2, _TOGETHER), np.float32)
    stride = np.uint64(first.shape[1])
    images = first.ravel(), second.ravel()
    for row in range(out.shape[0]):
        y = start + row
        for x in range(0, out.shape[1], _TOGETHER):
            line = out[row, x : x + _TOGETHER]
            pair = flow[y, x : x + line.size], later[y, x : x + line.size]
            _find_places(pair, -t * rest, -t * t, x, y, flow.shape, at, fractions)
            _weigh(fractions, weights)
            _sample(images[0], stride, at, weights, values[0], line.size)
            _find_places(pair, rest * rest, rest * t, x, y, flow.shape, at, fractions)
            _weigh(fractions, weights)
            _sample(images[1], stride, at, weights, values[1], line.size)
            for k in range(line.size):
                line[k] = max(rest * values[0, k] + t * values[1, k], np.float32(0))


@jit
def _find_places(pair, flow_share, later_share, x, y, shape, at, fractions):
    """Write where pixels of a row are sampled: an index into coefficients, and the rest in px."""
    flow, later = pair
    left, right = np.float32(-x), np.float32(shape[1] - 1 - x)
    top, bottom = np.float32(-y), np.float32(shape[0] - 1 - y)
    stride = np.int32(shape[1] + 3)
    corner = np.int32(y * stride + x)
    for k in range(len(flow)):
        past = np.float32(k)
        dx = flow_share * flow[k, 0] + later_share * later[k, 0]
        dy = flow_share * flow[k, 1] + later_share * later[k, 1]
        dx, dy = _within(dx, left - past, right - past), _within(dy, top, bottom)
        columns, rows = np.floor(dx), np.floor(dy)
        at[k] = corner + np.int32(k) + np.int32(rows) * stride + np.int32(columns)
        fractions[0, k], fractions[1, k] = dx - columns, dy - rows


@jit
def find_later(flow, out):
    """Write flow(q) at each pixel p = q + flow(q) of the second frame; both are (H, W, 2) px."""
    height, width, _ = flow.shape
    for y in range(height):
        top, bottom = np.float32(-y), np.float32(height - 1 - y)
        for x in range(width):
            left, right = np.float32(-x), np.float32(width - 1 - x)
            motion = flow[y, x, 0], flow[y, x, 1]
            for _ in range(_ROUNDS):
                dx, dy = _within(-motion[0], left, right), _within(-motion[1], top, bottom)
                columns, rows = np.floor(dx), np.floor(dy)
                a, c = x + np.int64(columns), y + np.int64(rows)
                b, d = min(a + 1, width - 1), min(c + 1, height - 1)
                fractions = dx - columns, dy - rows
                motion = (
                    _between(flow[c, a, 0], flow[c, b, 0], flow[d, a, 0], flow[d, b, 0], fractions),
                    _between(flow[c, a, 1], flow[c, b, 1], flow[d, a, 1], flow[d, b, 1], fractions),
                )
            out[y, x, 0], out[y, x, 1] = motion


@jit
def _between(a, b, c, d, fractions):
    """Interpolate bilinearly between four corners."""
    fx, fy = fractions
    above, below = a + fx * (b - a), c + fx * (d - c)
    return above + fy * (below - above)


@jit
def _within(value, least, most):
    value = value if value > least else least  # also if it is NaN
    return value if value < most else most


@jit
def _weigh(fractions, weights):
    """Write the weights of the four coefficients around each place, in x, then in y."""
    for axis in range(2):
        for k in range(_TOGETHER):
            f = fractions[axis, k]
            g = np.float32(1) - f
            weights[axis, 0, k] = _outer(g)
            weights[axis, 1, k] = _inner(f)
            weights[axis, 2, k] = _inner(g)
            weights[axis, 3, k] = _outer(f)


@jit
def _inner(x):
    """Return the weight of a coefficient at a distance of x up to 1 px."""
    x2 = x * x
    return np.float32(13 / 21) + x * np.float32(1 / 14) + x2 * (np.float32(0.5) * x - np.float32(1))


@jit
def _outer(x):
    """Return the weight of a coefficient at a distance of 2 - x px, x up to 1 px."""
    return x * (x * x * np.float32(1 / 6) + np.float32(1 / 42))


@jit
def _sample(c, stride, at, weights, values, size):
    """Write the light at places."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    x0, x1, x2, x3 = weights[0, 0], weights[0, 1], weights[0, 2], weights[0, 3]
    y0, y1, y2, y3 = weights[1, 0], weights[1, 1], weights[1, 2], weights[1, 3]
    for k in range(size):
        i = np.uint64(at[k])
        j, m, n = i + stride, i + two * stride, i + three * stride
        p, q, r, u = y0[k], y1[k], y2[k], y3[k]
        values[k] = (
            x0[k] * (p * c[i] + q * c[j] + r * c[m] + u * c[n])
            + x1[k] * (p * c[i + one] + q * c[j + one] + r * c[m + one] + u * c[n + one])
            + x2[k] * (p * c[i + two] + q * c[j + two] + r * c[m + two] + u * c[n + two])
            + x3[k] * (p * c[i + three] + q * c[j + three] + r * c[m + three] + u * c[n + three])
        )
