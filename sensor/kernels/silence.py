"""Find the few pixels that may fire over an interval; the others cost almost nothing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.elementary import exp, inlined, jit

# Relative safety margin of the float32 bounds on the light, and the range of these bounds.
BOUND_MARGIN = 1e-6
MIN_BOUND = 1e-30
MAX_BOUND = 1e38

# Greatest a dt of `flag_by_chord` and of `flag_by_cubic`: beyond them, the pixels that their wide
# bounds flag cost more than a narrower bound.
CHORD_STEP = 0.5
CUBIC_STEP = 4.0


class Comparators(NamedTuple):
    """The comparators of a block; a pixel fires when v2 is memory + C_on or memory - C_off."""

    memory: NDArray[np.float64]
    C_on: NDArray[np.float64]
    C_off: NDArray[np.float64]
    alike: bool  # all pixels have the same thresholds


class LightBand(NamedTuple):
    """The range of I + I_dark in which the ideal pixels of a block do not fire, without leakage."""

    darkest: NDArray[np.float32]
    brightest: NDArray[np.float32]
    fall: NDArray[np.float64]  # factor of the light to the next event, exp(-C_off)
    rise: NDArray[np.float64]  # exp(C_on)


@inlined
def light_bounds(level, leaked, fall, rise):
    """Return the light band of a pixel in float32, rounded so that it is never too wide.

    Parameters
    ----------
    level, leaked
        Memory, and its fall since `set_light_band`.
    fall, rise
        Factors of the light to the next event: exp(-C_off), exp(C_on).

    Returns
    -------
    darkest, brightest
    """
    light = exp(level + leaked)
    darkest = max(light * fall * (1.0 + BOUND_MARGIN), MIN_BOUND)
    brightest = min(light * rise * (1.0 - BOUND_MARGIN), MAX_BOUND)
    return np.float32(darkest), np.float32(brightest if light > MIN_BOUND else 0.0)


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
    memory, C_on, C_off, alike = comparators
    darkest, brightest, fall, rise = light_band
    if alike:
        down, up = exp(-C_off[0]), exp(C_on[0])
        for i in range(n):
            fall[i], rise[i] = down, up
    else:
        for i in range(n):
            fall[i], rise[i] = exp(-C_off[i]), exp(C_on[i])
    for i in range(n):
        darkest[i], brightest[i] = light_bounds(memory[i], 0.0, fall[i], rise[i])


@jit
def flag_ideal(light, f, pixels, fade, light_band, flag):
    """Flag ideal pixels with light outside their band, or with invalid light, without a logarithm.

    Parameters
    ----------
    light, f, pixels
        `PixelLight`, frame at the end of the interval, and slice of the pixels.
    fade, light_band, flag
        As in `flag_outside`.
    """
    if light.double.size > 0:
        flag_outside(light.double[f, pixels], light.dark, fade, light_band, flag)
    else:
        # Next to the subnormals a float32 has few digits; 0 flags all, which is safe.
        dark, fade_32 = np.float32(light.dark), np.float32(fade if fade > 1e-30 else 0.0)
        flag_outside(light.single[f, pixels], dark, fade_32, light_band, flag)


@jit
def flag_outside(radiance, dark, fade, light_band, flag):
    """Flag the light outside a band, or invalid light.

    Parameters
    ----------
    radiance, dark
        (n,) linear radiance, and I_dark.
    fade
        Factor on the bounds by leakage since `set_light_band`.
    light_band
        The bounds.
    flag
        (n,) output.
    """
    darkest, brightest = light_band.darkest, light_band.brightest
    for i in range(radiance.size):
        light = radiance[i] + dark
        silent = (light > darkest[i] * fade) & (light < brightest[i] * fade)
        flag[i] = not (silent & (radiance[i] >= 0.0))


class Ends(NamedTuple):
    """A filtered pixel at both ends of an interval, and its comparator."""

    u0: float  # log intensity
    u1: float
    v1: float  # outputs of the poles at the start
    v2: float
    v2_end: float  # and at the end
    memory: float
    C_on: float
    C_off: float


@inlined
def may_fire(ends, x, e, drift, poles):
    """Return whether v2 may leave (memory - C_off, memory + C_on) during an interval.

    v2 can leave the band within the interval and return, so its value at the end is not enough. It
    stays inside if one of three bounds holds. With y = a t, the n-th derivative of v2, n > 1, is
    (-1)^n (B - n A + A y) e^{-y}, hence

    1. v2 is monotone when neither its slope nor its curvature changes sign between the ends,
    2. it differs from its chord by at most x^2 / 8 times its largest curvature,
    3. and from its cubic Hermite interpolant by at most x^4 / 384 times its largest 4th derivative;
       the interpolant stays between the least and the greatest of its Bezier points.

    Parameters
    ----------
    ends
        The pixel.
    x, e
        a dt and exp(-a dt).
    drift
        Fall of the memory over the interval, log units.
    poles
        1 or 2.
    """
    u0, u1, v1, v2, v2_end, memory, C_on, C_off = ends
    second = poles - 1.0
    inverse_x = 1.0 / x
    S = (u1 - u0) * inverse_x
    A = second * (v1 - u0 + S)
    B = v2 - u0 + poles * S
    Ax = A * x
    rise = S + drift * inverse_x
    slope_start = rise + A - B
    slope_end = rise + (A - B - Ax) * e
    curvature_start = B - 2.0 * A
    curvature_end = curvature_start + Ax  # times e^{-x}, which is at most 1
    fourth = B - 4.0 * A
    start = v2 - memory
    end = v2_end + drift - memory
    third = x * (1.0 / 3.0)
    inner_0 = start + third * slope_start
    inner_1 = end - third * slope_end
    square = x * x
    off_chord = square * (1.0 / 8.0) * max(abs(curvature_start), abs(curvature_end))
    off_cubic = square * square * (1.0 / 384.0) * max(abs(fourth), abs(fourth + Ax))
    top = max(start, end)
    bottom = min(start, end)
    over = (top + off_chord >= C_on) & (max(top, max(inner_0, inner_1)) + off_cubic >= C_on)
    under = (off_chord - bottom >= C_off) & (
        off_cubic - min(bottom, min(inner_0, inner_1)) >= C_off
    )
    turns = (curvature_start * curvature_end < 0.0) | (slope_start * slope_end < 0.0)
    return (end >= C_on) | (-end >= C_off) | (turns & (over | under))


@jit
def flag_in_own_light(n, response, x, e, drift, comparators, flag):
    """Flag the pixels that `may_fire`, each with its own cutoff.

    Parameters
    ----------
    n, response
        Number of pixels, and `Response` with `v2_end`.
    x, e
        (n,) a dt and exp(-a dt).
    drift
        Fall of the memory over the interval, log units.
    comparators
        Memory and thresholds.
    flag
        Output, padded with False to whole 8-byte words.
    """
    u0, u1, v1, v2, _, v2_end, poles = response
    memory, C_on, C_off, _ = comparators
    for i in range(n):
        ends = Ends(u0[i], u1[i], v1[i], v2[i], v2_end[i], memory[i], C_on[i], C_off[i])
        flag[i] = may_fire(ends, x[i], e[i], drift, poles)


@jit
def flag_by_all(n, response, step, drift, comparators, flag):
    """Advance the poles of n pixels, and flag those that `may_fire`.

    Parameters
    ----------
    n, response
        Number of pixels, and `Response`; its `v1_end` and `v2_end` are output.
    step
        An entry of an array of `STEP`.
    drift, comparators, flag
        As in `flag_in_own_light`.
    """
    u0, u1, v1, v2, v1_end, v2_end, poles = response
    memory, C_on, C_off, _ = comparators
    x, e, v1_u0, v1_u1 = step.x, step.e, step.v1_u0, step.v1_u1
    v2_v1, v2_u0, v2_u1 = step.v2_v1, step.v2_u0, step.v2_u1
    for i in range(n):
        v1_end[i] = e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_1 = e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]
        v2_end[i] = v2_1
        ends = Ends(u0[i], u1[i], v1[i], v2[i], v2_1, memory[i], C_on[i], C_off[i])
        flag[i] = may_fire(ends, x, e, drift, poles)


@jit
def flag_by_cubic(n, response, step, drift, comparators, flag):
    """Advance the poles of n pixels and flag as `flag_by_all` does, up to an a dt of CUBIC_STEP.

    A pixel is silent if v2 cannot reach a level by the third bound of `may_fire`; the other bounds
    would exclude few of the remaining pixels. The slopes follow from the state: v1 - v2 of two
    poles, u - v2 of one pole.

    Parameters
    ----------
    n, response, step, drift, comparators, flag
        As in `flag_by_all`.
    """
    u0, u1, v1, v2, v1_end, v2_end, poles = response
    memory, C_on, C_off, _ = comparators
    x, e, v1_u0, v1_u1 = step.x, step.e, step.v1_u0, step.v1_u1
    v2_v1, v2_u0, v2_u1 = step.v2_v1, step.v2_u0, step.v2_u1
    second = poles - 1.0
    inverse_x, third = 1.0 / x, x * (1.0 / 3.0)
    off_cubic = x * x * x * x * (1.0 / 384.0)
    leak = drift * (1.0 / 3.0)
    for i in range(n):
        v1_1 = e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_1 = e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]
        v1_end[i], v2_end[i] = v1_1, v2_1
        S = (u1[i] - u0[i]) * inverse_x
        to_v1, to_v2 = v1[i] - u0[i], v2[i] - u0[i]
        A = second * (to_v1 + S)
        fourth = to_v2 + poles * S - 4.0 * A
        slope_start = second * to_v1 - to_v2
        slope_end = second * (v1_1 - u1[i]) - (v2_1 - u1[i])
        start = v2[i] - memory[i]
        end = v2_1 - memory[i] + drift
        inner_0 = start + third * slope_start + leak
        inner_1 = end - third * slope_end - leak
        off = off_cubic * max(abs(fourth), abs(fourth + A * x))
        top = max(max(start, end), max(inner_0, inner_1))
        bottom = min(min(start, end), min(inner_0, inner_1))
        flag[i] = (top + off >= C_on[i]) | (off - bottom >= C_off[i])


@jit
def flag_by_chord(n, response, step, drift, comparators, flag):
    """Advance the poles of n pixels and flag as `flag_by_all` does, up to an a dt of CHORD_STEP.

    A pixel is silent if v2 cannot reach a level by the second bound of `may_fire`, which is narrow
    over a short interval. The curvature of v2 at an end follows from the state there: it is
    u - 2 v1 + v2 of two poles, and that of one pole is constant but for the factor e^{-y}.

    Parameters
    ----------
    n, response, step, drift, comparators, flag
        As in `flag_by_all`.
    """
    u0, u1, v1, v2, v1_end, v2_end, poles = response
    memory, C_on, C_off, _ = comparators
    e, v1_u0, v1_u1 = step.e, step.v1_u0, step.v1_u1
    v2_v1, v2_u0, v2_u1 = step.v2_v1, step.v2_u0, step.v2_u1
    second = poles - 1.0
    of_v1, of_u, of_slope = 2.0 * second, 2.0 * second - 1.0, (1.0 - second) / step.x
    grown = 1.0 / step.e
    off_chord = step.x * step.x * (1.0 / 8.0)
    for i in range(n):
        v1_1 = e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_1 = e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]
        v1_end[i], v2_end[i] = v1_1, v2_1
        S = of_slope * (u1[i] - u0[i])
        curvature_start = of_u * u0[i] - of_v1 * v1[i] + v2[i] + S
        curvature_end = of_u * u1[i] - of_v1 * v1_1 + v2_1 + S
        off = off_chord * max(abs(curvature_start), abs(curvature_end) * grown)
        start = v2[i] - memory[i]
        end = v2_1 + drift - memory[i]
        flag[i] = (max(start, end) + off >= C_on[i]) | (off - min(start, end) >= C_off[i])


# Row m: positions of the set bits of m, then zeros.
_SET_BITS = np.array(
    [[*(bit for bit in range(8) if m >> bit & 1), *[0] * (8 - m.bit_count())] for m in range(256)],
    np.uint64,
)
_ONES = np.uint64(0x0101010101010101)  # times a word of 8 flags: their sum in the highest byte
_BITS = np.uint64(0x0102040810204080)  # times a word of 8 flags: their bits in the highest byte


@jit
def list_flagged(flag, n, index):
    """List the indices of the flagged pixels; 8 flags are looked up in a table at a time.

    Parameters
    ----------
    flag
        Flags of n pixels, padded with False to whole 8-byte words.
    n
        Number of pixels.
    index
        Output, with 8 more entries as scratch memory.

    Returns
    -------
    int
        Number of flagged pixels.
    """
    words = flag.view(np.uint64)
    count = np.uint64(0)  # unsigned: Numba checks if signed indices are negative
    for k in range(np.uint64((n + 7) // 8)):
        word = words[k]
        if word != np.uint64(0):
            bits = (word * _BITS) >> np.uint64(56)
            first = k * np.uint64(8)
            for j in range(np.uint64(8)):
                index[count + j] = first + _SET_BITS[bits, j]
            count += (word * _ONES) >> np.uint64(56)
    return np.int64(count)
