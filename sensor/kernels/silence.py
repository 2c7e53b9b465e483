"""Which pixels cannot fire over an interval: most, and those cost next to nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload
from numpy.typing import NDArray

from sensor.kernels.elementary import exp, jit

# Float32 bounds on the light are drawn in by this much, and held within what float32 does well.
BOUND_MARGIN = 1e-6
LEAST_BOUND = 1e-30
GREATEST_BOUND = 1e38


class Comparators(NamedTuple):
    """The levels that a block's pixels compare v2 with, and how far off it is when they fire."""

    memory: NDArray[np.float64]
    C_on: NDArray[np.float64]
    C_off: NDArray[np.float64]


class LightBand(NamedTuple):
    """Between which I + I_dark a block's ideal pixels keep silent while their memory stands."""

    darkest: NDArray[np.float32]
    brightest: NDArray[np.float32]


@jit
def light_bound(log_light, margin):
    """exp(log_light) (1 + margin) in float32: a bound that errs towards a flag."""
    light = exp(log_light) * (1.0 + margin)
    if margin > 0.0:
        return np.float32(max(light, LEAST_BOUND))
    return np.float32(min(light, GREATEST_BOUND) if light > LEAST_BOUND else 0.0)


@jit
def set_light_band(n, comparators, light_band):
    """Set the band of light in which ideal pixels keep silent from their memory."""
    memory, C_on, C_off = comparators
    darkest, brightest = light_band
    for i in range(n):
        darkest[i] = light_bound(memory[i] - C_off[i], BOUND_MARGIN)
        brightest[i] = light_bound(memory[i] + C_on[i], -BOUND_MARGIN)


@jit
def flag_ideal(radiance, dark, fade, light_band, flag):
    """Flag ideal pixels whose light is not within their band, or is no light; no logarithm needed.

    `fade` is what the leaks since the band was set have left of its bounds.
    """
    darkest, brightest = light_band
    for i in range(radiance.size):
        light = radiance[i] + dark
        silent = (light > darkest[i] * fade) & (light < brightest[i] * fade)
        flag[i] = not (silent & (radiance[i] >= 0.0))


def each(value, i):
    """The i-th pixel's of an array, or the number that all pixels share."""


@overload(each)
def _each(value, i):
    if isinstance(value, types.Array):
        return lambda value, i: value[i]
    return lambda value, i: value


@jit
def flag_filtered(n, response, x, e, drift, comparators, flag):
    """Flag the pixels where v2 may leave (memory - C_off, memory + C_on) during an interval.

    v2 can leave the band in mid-interval and come back, so its end alone does not decide; but it
    has not if any of three bounds keeps it inside. With y = a t, the n-th derivative of v2, n > 1,
    is (-1)^n (B - n A + A y) e^{-y}, hence

    1. v2 is monotone when neither its slope nor its curvature changes sign between the ends,
    2. it stays within x^2 / 8 times its largest curvature of its chord,
    3. and within x^4 / 384 times its largest 4th derivative of its cubic Hermite interpolant,
       which stays between the least and the greatest of its Bezier points.

    No flag is proof of no event.
    """
    u0, u1, v1, v2, _, v2_end, poles = response
    memory, C_on, C_off = comparators
    second = poles - 1.0
    for i in range(n):
        xi, ei = each(x, i), each(e, i)
        inverse_x = 1.0 / xi
        S = (u1[i] - u0[i]) * inverse_x
        A = second * (v1[i] - u0[i] + S)
        B = v2[i] - u0[i] + poles * S
        Ax = A * xi
        rise = S + drift * inverse_x
        slope_start = rise + A - B
        slope_end = rise + (A - B - Ax) * ei
        curvature_start = B - 2.0 * A
        curvature_end = curvature_start + Ax  # times e^{-x}, which is at most 1
        fourth = B - 4.0 * A
        start = v2[i] - memory[i]
        end = v2_end[i] + drift - memory[i]
        third = xi * (1.0 / 3.0)
        inner_0 = start + third * slope_start
        inner_1 = end - third * slope_end
        square = xi * xi
        off_chord = square * (1.0 / 8.0) * max(abs(curvature_start), abs(curvature_end))
        off_cubic = square * square * (1.0 / 384.0) * max(abs(fourth), abs(fourth + Ax))
        top = max(start, end)
        bottom = min(start, end)
        over = (top + off_chord >= C_on[i]) & (
            max(top, max(inner_0, inner_1)) + off_cubic >= C_on[i]
        )
        under = (off_chord - bottom >= C_off[i]) & (
            off_cubic - min(bottom, min(inner_0, inner_1)) >= C_off[i]
        )
        turns = (curvature_start * curvature_end < 0.0) | (slope_start * slope_end < 0.0)
        flag[i] = (end >= C_on[i]) | (-end >= C_off[i]) | (turns & (over | under))


@jit
def list_flagged(flag, n, index):
    """Indices of the flagged ones of n pixels, in `index`. No branch to mispredict.

    `flag` is padded with False to whole words.
    """
    words = flag.view(np.uint64)
    count = 0
    for word in range((n + 7) // 8):
        if words[word] != 0:
            for i in range(8 * word, 8 * word + 8):
                index[count] = i
                count += flag[i]
    return index[:count]
