"""Find the few pixels that may fire over an interval; the others cost almost nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba.core import types
from numba.extending import overload
from numpy.typing import NDArray

from sensor.kernels.elementary import exp, jit

# Relative safety margin of the float32 bounds on the light, and the range of these bounds.
BOUND_MARGIN = 1e-6
LEAST_BOUND = 1e-30
GREATEST_BOUND = 1e38


class Comparators(NamedTuple):
    """The comparators of a block; a pixel fires when v2 is memory + C_on or memory - C_off."""

    memory: NDArray[np.float64]
    C_on: NDArray[np.float64]
    C_off: NDArray[np.float64]


class LightBand(NamedTuple):
    """The range of I + I_dark in which the ideal pixels of a block do not fire, without leakage."""

    darkest: NDArray[np.float32]
    brightest: NDArray[np.float32]


@jit
def light_bound(log_light, margin):
    """Return exp(log_light) (1 + margin) in float32, a bound that rather flags too many pixels.

    Parameters
    ----------
    log_light
        Logarithm of I + I_dark.
    margin
        Positive for a lower bound, negative for an upper one.

    Returns
    -------
    float32
    """
    light = exp(log_light) * (1.0 + margin)
    if margin > 0.0:
        return np.float32(max(light, LEAST_BOUND))
    return np.float32(min(light, GREATEST_BOUND) if light > LEAST_BOUND else 0.0)


@jit
def set_light_band(n, comparators, light_band):
    """Compute the light band of n ideal pixels from their memory.

    Parameters
    ----------
    n
        Number of pixels.
    comparators, light_band
        Input and output.
    """
    memory, C_on, C_off = comparators
    darkest, brightest = light_band
    for i in range(n):
        darkest[i] = light_bound(memory[i] - C_off[i], BOUND_MARGIN)
        brightest[i] = light_bound(memory[i] + C_on[i], -BOUND_MARGIN)


@jit
def flag_ideal(radiance, dark, fade, light_band, flag):
    """Flag ideal pixels with light outside their band, or with invalid light, without a logarithm.

    Parameters
    ----------
    radiance, dark
        (n,) linear radiance at the end of the interval, and I_dark.
    fade
        Factor on the bounds by leakage since `set_light_band`.
    light_band
        The bounds.
    flag
        (n,) output.
    """
    darkest, brightest = light_band
    for i in range(radiance.size):
        light = radiance[i] + dark
        silent = (light > darkest[i] * fade) & (light < brightest[i] * fade)
        flag[i] = not (silent & (radiance[i] >= 0.0))


def each(value, i):
    """Return the value of pixel i: an entry of an array, or the number that all pixels share.

    Parameters
    ----------
    value
        (n,) array, or a number.
    i
        Index of the pixel.
    """


@overload(each)
def _each(value, i):
    if isinstance(value, types.Array):
        return lambda value, i: value[i]
    return lambda value, i: value


@jit
def flag_filtered(n, response, x, e, drift, comparators, flag):
    """Flag the pixels where v2 may leave (memory - C_off, memory + C_on) during an interval.

    A pixel without a flag has no event. v2 can leave the band within the interval and return, so
    its value at the end is not enough. It stays inside if one of three bounds holds. With y = a t,
    the n-th derivative of v2, n > 1, is (-1)^n (B - n A + A y) e^{-y}, hence

    1. v2 is monotone when neither its slope nor its curvature changes sign between the ends,
    2. it differs from its chord by at most x^2 / 8 times its largest curvature,
    3. and from its cubic Hermite interpolant by at most x^4 / 384 times its largest 4th derivative;
       the interpolant stays between the least and the greatest of its Bezier points.

    Parameters
    ----------
    n, response
        Number of pixels, and `Response` with `v2_end`.
    x, e
        a dt and exp(-a dt): (n,), or one number for all pixels.
    drift
        Fall of the memory over the interval, log units.
    comparators
        Memory and thresholds.
    flag
        Output, padded with False to whole 8-byte words.
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
    """Return the indices of the flagged pixels, without branches that the processor mispredicts.

    Parameters
    ----------
    flag
        Flags of n pixels, padded with False to whole 8-byte words.
    n
        Number of pixels.
    index
        Memory for the result.

    Returns
    -------
    (count,) part of `index`
    """
    words = flag.view(np.uint64)
    count = 0
    for word in range((n + 7) // 8):
        if words[word] != 0:
            for i in range(8 * word, 8 * word + 8):
                index[count] = i
                count += flag[i]
    return index[:count]
