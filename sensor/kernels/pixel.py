"""Every jitted kernel of the pixel: the paper's equations, one after the other.

Between two frames the log intensity u is a straight line in time. One *setting* is a pixel's
electronics together with a time axis: contrast threshold C, photoreceptor poles a = 2 pi f_cutoff,
and the frames' times. Kernels walk over blocks of pixels and take each block through several frame
intervals of every setting before going on, so that a block's state stays in the second-level cache.

A pixel's state at a frame time, float64:

u      log intensity, log(I + I_dark)
v1, v2 outputs of the photoreceptor's two poles; v2 is the voltage L of Eq. (1)
memory the level that v2 is compared with
"""

from __future__ import annotations

import math

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload

# "contract" lets a * b + c become one rounding; nothing else about float64 is relaxed.
jit = numba.njit(cache=True, nogil=True, fastmath={"contract"}, error_model="numpy")
# For what is called in loops that must become vectors: a call that stays a call ends them.
inlined = numba.njit(
    cache=True, nogil=True, fastmath={"contract"}, error_model="numpy", forceinline=True
)

# An event while it waits to be sorted, in one uint64: microseconds since the rounded start of its
# frame interval, polarity, row, column.
TIME_SHIFT = np.uint64(33)
POLARITY_SHIFT = np.uint64(32)
ROW_SHIFT = np.uint64(16)
COORDINATE_MASK = np.uint64(0xFFFF)
PLACE_MASK = np.uint64(0xFFFFFFFF)
MAX_INTERVAL_US = (1 << 31) - 2

# How far a frame interval's step reaches, one row of `step` for each setting and interval.
DT_S, X, E, V1_U0, V1_U1, V2_V1, V2_U0, V2_U1 = range(8)
STEP_SIZE = 8

# A setting's electronics, one row of `electronics` each.
POLES, LEAK_PER_S, NOISE_HZ, NOISE_EXPONENT, LIGHT_A = range(5)
ELECTRONICS_SIZE = 5


@intrinsic
def _bits_of(typingctx, x):
    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic
def _float_of(typingctx, bits):
    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


@jit
def log(x):
    """Natural logarithm of a positive, normal float64, to 1 ulp, in a form that vectorises.

    The reduction and polynomial of FreeBSD's msun e_log.c: x = 2^k (1 + f), sqrt(1/2) <= 1 + f <
    sqrt(2), s = f / (2 + f).
    """
    shifted = _bits_of(x) + (0x3FF0000000000000 - 0x3FE6A09E00000000)
    biased = (shifted >> 52) & 0x7FF
    f = _float_of((shifted & 0xFFFFFFFFFFFFF) + 0x3FE6A09E00000000) - 1.0
    k = _float_of(biased | 0x4330000000000000) - (4503599627370496.0 + 1023.0)
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (
        3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01)
    )
    even = z * (
        6.666666666666735130e-01
        + w
        * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half_square = 0.5 * f * f
    return k * 6.93147180369123816490e-01 - (
        (half_square - (s * (half_square + odd + even) + k * 1.90821492927058770002e-10)) - f
    )


@inlined
def exp_parts(x):
    """(scale, r, tail) with exp(x) = scale (1 + r + tail); beyond |x| = 700, of exp(+-700).

    exp(x) = 2^k exp(r) with k an integer and |r| <= ln(2) / 2; the tail of exp(r), from r^2 / 2 on,
    by its Taylor series. Where |x| < ln(2) / 2, r is x and the scale is 1.
    """
    x = max(min(x, 700.0), -700.0)
    shifted = x * 1.4426950408889634 + 6755399441055744.0  # k in the lowest bits
    k = shifted - 6755399441055744.0
    r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
    p = 1.0 / 479001600.0
    p = p * r + 1.0 / 39916800.0
    p = p * r + 1.0 / 3628800.0
    p = p * r + 1.0 / 362880.0
    p = p * r + 1.0 / 40320.0
    p = p * r + 1.0 / 5040.0
    p = p * r + 1.0 / 720.0
    p = p * r + 1.0 / 120.0
    p = p * r + 1.0 / 24.0
    p = p * r + 1.0 / 6.0
    p = p * r + 0.5
    return _float_of(((_bits_of(shifted) + 1023) & 0x7FF) << 52), r, r * r * p


@inlined
def exp(x):
    """exp(x) for |x| <= 700, to 1 ulp or so, in a form that vectorizes; beyond, exp(+-700)."""
    scale, r, tail = exp_parts(x)
    return scale * (1.0 + (r + tail))


@jit
def integrate_area(
    frame,  # (H, W)
    row_first,  # overlaps of the rows, as `optics.area_weights` gives them
    row_count,
    row_weight,
    col_first,  # and of the columns
    col_count,
    col_weight,
    out,  # (height, width) out
):
    """I = k * E, Eq. (3): the mean over each pixel's area, rows first.

    Returns whether all radiance is finite and at least 0.
    """
    good = True
    height, width = out.shape
    line = np.empty(frame.shape[1])
    for y in range(height):
        line[:] = 0.0
        for j in range(row_count[y]):
            weight = row_weight[y, j]
            source = frame[row_first[y] + j]
            for x in range(line.size):
                good &= (source[x] >= 0.0) & (source[x] < np.inf)
                line[x] += weight * source[x]
        for x in range(width):
            total = 0.0
            for j in range(col_count[x]):
                total += col_weight[x, j] * line[col_first[x] + j]
            out[y, x] = total
    return good


@jit
def log_intensity(
    radiance,  # (n,) linear radiance
    dark,  # I_dark
    u,  # (n,) out
):
    """u = log(I + I_dark). Returns whether all radiance is finite and at least 0."""
    good = True
    for i in range(u.size):
        good &= (radiance[i] >= 0.0) & (radiance[i] < np.inf)
        u[i] = log(radiance[i] + dark)
    return good


# Below the least a dt a pole stands still, above the greatest it lags by nothing: to float64, both
# are exact. No cutoff and no light overflows.
LEAST_X = 1e-30
GREATEST_X = 1e16


@jit
def within_float(x):
    """x = a dt, held where float64 holds what is computed from it."""
    return min(max(x, LEAST_X), GREATEST_X)


def photoreceptor_step(dt_s: float, cutoff_hz: float, poles: int = 2) -> np.ndarray:
    """Coefficients that take the poles exactly over one frame interval.

    For the input u0 + s t, with x = a dt, e = exp(-x) and phi = (1 - e) / x, the closed forms
    v1(dt) = u0 + s dt - s/a + A e and v2(dt) = u0 + s dt - 2 s/a + (B + A x) e are linear in the
    state and in both frames' u. With a single pole, v2 follows v1's form.
    """
    step = np.zeros(STEP_SIZE)
    step[DT_S] = dt_s
    if math.isinf(cutoff_hz):
        return step
    x = within_float(2.0 * math.pi * float(dt_s) * float(cutoff_hz))
    e = math.exp(-x)
    phi = -math.expm1(-x) / x
    step[X], step[E] = x, e
    step[V1_U0], step[V1_U1] = phi - e, 1.0 - phi
    if poles == 1:
        step[V2_U0], step[V2_U1] = step[V1_U0], step[V1_U1]
        return step
    step[V2_V1], step[V2_U1] = x * e, 1.0 + e - 2.0 * phi
    step[V2_U0] = 1.0 - e - x * e - step[V2_U1]
    return step


@jit
def poles_to_end(n, u0, u1, v1, v2, step, v1_end, v2_end):
    """Take the poles over one interval."""
    step_e = step[E]
    v1_u0, v1_u1 = step[V1_U0], step[V1_U1]
    v2_v1, v2_u0, v2_u1 = step[V2_V1], step[V2_U0], step[V2_U1]
    for i in range(n):
        v1_end[i] = step_e * v1[i] + v1_u0 * u0[i] + v1_u1 * u1[i]
        v2_end[i] = step_e * v2[i] + v2_v1 * v1[i] + v2_u0 * u0[i] + v2_u1 * u1[i]


@jit
def poles_to_end_in_own_light(n, u0, u1, v1, v2, dt_s, electronics, v1_end, v2_end, x, e):
    """As `poles_to_end`, for a cutoff proportional to the light: a = LIGHT_A (I + I_dark).

    Over an interval the cutoff is held at that of the middle of its log intensity, which sets each
    pixel's own x and e.
    """
    two = electronics[POLES] == 2.0
    for i in range(n):
        xi = within_float(electronics[LIGHT_A] * dt_s * math.exp(0.5 * (u0[i] + u1[i])))
        ei = math.exp(-xi)
        phi = -math.expm1(-xi) / xi
        x[i] = xi
        e[i] = ei
        v1_end[i] = ei * v1[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]
        if two:
            ramp = 1.0 + ei - 2.0 * phi
            v2_end[i] = (
                ei * v2[i] + xi * ei * v1[i] + (1.0 - ei - xi * ei - ramp) * u0[i] + ramp * u1[i]
            )
        else:
            v2_end[i] = ei * v2[i] + (phi - ei) * u0[i] + (1.0 - phi) * u1[i]


# Float32 bounds on the light are drawn in by this much, and held within what float32 does well.
BOUND_MARGIN = 1e-6
LEAST_BOUND = 1e-30
GREATEST_BOUND = 1e38


@jit
def light_bound(log_light, margin):
    """exp(log_light) (1 + margin) in float32: a bound that errs towards a flag."""
    light = exp(log_light) * (1.0 + margin)
    if margin > 0.0:
        return np.float32(max(light, LEAST_BOUND))
    return np.float32(min(light, GREATEST_BOUND) if light > LEAST_BOUND else 0.0)


@jit
def band_of_light(n, memory, C_on, C_off, darkest, brightest):
    """Between which I + I_dark ideal pixels keep silent, as long as their memory does not leak."""
    for i in range(n):
        darkest[i] = light_bound(memory[i] - C_off[i], BOUND_MARGIN)
        brightest[i] = light_bound(memory[i] + C_on[i], -BOUND_MARGIN)


@jit
def flag_ideal(radiance, dark, fade, darkest, brightest, flag):
    """Flag ideal pixels whose light is not within their band, or is no light; no logarithm needed.

    `fade` is what the leaks since the band was set have left of its bounds.
    """
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
def flag_filtered(n, u0, u1, v1, v2, v2_end, x, e, poles, drift, memory, C_on, C_off, flag):
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


# Beyond y = a t = TRANSIENT nothing is left of a transient: y^2 e^{-y} < 1e-24.
TRANSIENT = 64.0
# Up to this a dt a curve is written in its short form.
SHORT_X = 0.25

# v2 within an interval, in y = a t. With S = s/a and k poles it is, in its long form,
#
#   v2(y) = (u0 - k S) + S y + (B + A y) e^{-y}, A = (k - 1) (v1 - u0 + S), B = v2 - u0 + k S
#
# and the same in its short form, for a dt so small that S would cancel the rest away:
#
#   v2(y) = v2 + v2'(0) y - A y^2 + (B + A y) (e^{-y} - 1 + y).
#
# Both are START_V + RISE y - SHORT A y^2 + (B + A y) decay(y, SHORT). What the memory leaks comes
# on top of the slope.
#
# A crossing to be solved, one column each: v2(y) = LEVEL for y in [LOW, HIGH], v2 monotone there.
# US is what a unit of y takes in microseconds, SLACK what y may be off by.
START_V, RISE, POLE_A, POLE_B, SHORT, LEVEL, LOW, HIGH, V_LOW, V_HIGH, US, SLACK, ROOT = range(13)
CROSSING_SIZE = 13
CROSSING_BATCH = 520  # no power of two: the columns must not fall on the same lines of the cache


@inlined
def decay(y, short):
    """e^{-y} where short is 0; where it is 1, for y < ln(2) / 2, e^{-y} - 1 + y to all digits."""
    scale, r, tail = exp_parts(-y)
    return scale * (tail + (1.0 - short) * (1.0 + r))


@inlined
def v2_at(y, start, rise, A, B, short):
    """v2 at y = a t."""
    return start + y * (rise - short * A * y) + (B + A * y) * decay(y, short)


@inlined
def v2_and_slopes_at(y, start, rise, A, B, short):
    """v2 and its first three derivatives by y at y = a t."""
    E = decay(y, short)
    E1 = short * y - E
    E2 = short - E1
    w = B + A * y
    square = short * A
    v = start + y * (rise - square * y) + w * E
    slope = rise - 2.0 * square * y + A * E + w * E1
    curvature = -2.0 * square + 2.0 * A * E1 + w * E2
    return v, slope, curvature, (3.0 * A - w) * E2


@jit
def turning_point(low, high, rise, A, B, short):
    """Root of v2's slope between low and high, where it changes its sign exactly once.

    Halley's method, kept inside a shrinking bracket, which is halved where a step is outside of it
    or is not half as long as the one before. v2 is flat here: an error of 1e-8 in the root leaves
    one of 1e-16 in v2.
    """
    slope_low = v2_and_slopes_at(low, 0.0, rise, A, B, short)[1]
    slope_high = v2_and_slopes_at(high, 0.0, rise, A, B, short)[1]
    falling = slope_low > slope_high
    close = 1e-4 * min(high - low, 1.0)
    moved = high - low
    y = low + moved * min(max(slope_low / (slope_low - slope_high), 0.0), 1.0)
    for _ in range(200):
        _, slope, curvature, third = v2_and_slopes_at(y, 0.0, rise, A, B, short)
        if (slope > 0.0) == falling:
            low = y
        else:
            high = y
        better = y - 2.0 * slope * curvature / (2.0 * curvature * curvature - slope * third)
        if not (low <= better <= high and abs(better - y) <= 0.5 * moved):
            better = 0.5 * (low + high)
        moved = abs(better - y)
        y = better
        if moved < close:
            break
    return y


@inlined
def halley(y, level, start, rise, A, B, short, slack):
    """One step of Halley's method towards v2(y) = level. Returns (next y, error, near).

    Near means that the next y is off by less than the slack. With d = error / slope, about the
    distance left, the step leaves at most about d^3 (bend^2 + |third|), the second and the third
    derivative over the first. The step's own length would not do: it is short near any turn of v2,
    wherever the level is.
    """
    v, slope, curvature, third = v2_and_slopes_at(y, start, rise, A, B, short)
    error = v - level
    inverse = 1.0 / slope
    distance = error * inverse
    bend = curvature * inverse
    better = y - distance / (1.0 - 0.5 * distance * bend)
    left = abs(distance * distance * distance) * (bend * bend + abs(third * inverse))
    return better, error, (abs(distance) < 0.01) & (left < slack)


@jit
def crossing(level, low, high, v_low, v_high, start, rise, A, B, short, slack):
    """y in [low, high] at which v2, monotone there, takes the level: slowly, but surely.

    Halley's method kept inside a shrinking bracket, which is halved where a step is outside of it
    or is not half as long as the one before. It starts where the chord crosses the level, or, if
    that comes first, where an exponential tail would: along a tail, Halley's own steps are no
    longer than 2.
    """
    share = (level - v_low) / (v_high - v_low)
    if low >= TRANSIENT:  # a straight line
        return low + (high - low) * min(max(share, 0.0), 1.0)
    rising = v_high > v_low
    moved = high - low
    y = low + min(moved * share, -math.log1p(-share) if share < 1.0 else moved)
    y = min(max(y, low), high)
    for _ in range(200):
        better, error, near = halley(y, level, start, rise, A, B, short, slack)
        if (error < 0.0) == rising:
            low = y
        else:
            high = y
        if not (low <= better <= high and abs(better - y) <= 0.5 * moved):
            better = 0.5 * (low + high)
            near = False
        moved = abs(better - y)
        y = better
        if near or high - low < slack:
            break
    return y


@jit
def solve_crossings(todo, count):
    """Fill in the roots of the first `count` columns: three steps for all at once, in vectors.

    The few that have not converged by then, near a turn of v2 or far down a tail, are solved one by
    one.
    """
    start, rise, A, B, short = todo[START_V], todo[RISE], todo[POLE_A], todo[POLE_B], todo[SHORT]
    low, high, v_low, v_high = todo[LOW], todo[HIGH], todo[V_LOW], todo[V_HIGH]
    level, slack, root = todo[LEVEL], todo[SLACK], todo[ROOT]
    for k in range(count):
        curve = level[k], start[k], rise[k], A[k], B[k], short[k], slack[k]
        y = low[k] + (high[k] - low[k]) * ((level[k] - v_low[k]) / (v_high[k] - v_low[k]))
        better, _, _ = halley(y, *curve)
        y = min(max(better, low[k]), high[k])
        better, _, _ = halley(y, *curve)
        y = min(max(better, low[k]), high[k])
        better, _, near = halley(y, *curve)
        # A root is a number of at least 0: less marks what is still to be done.
        root[k] = min(max(better, low[k]), high[k]) if near else -1.0
    for k in range(count):
        if not root[k] >= 0.0:
            curve = start[k], rise[k], A[k], B[k], short[k], slack[k]
            root[k] = crossing(level[k], low[k], high[k], v_low[k], v_high[k], *curve)


@jit
def pack(since_us, start_us, length_us, polarity_and_position):
    """One event as a sortable word; the one place where a float time becomes microseconds.

    The event comes `since_us` after its interval starts. Rounding never takes it out of the
    interval.
    """
    t_us = np.int64(math.floor(start_us + since_us + 0.5))
    return (np.uint64(min(max(t_us, 0), length_us)) << TIME_SHIFT) | polarity_and_position


@jit
def list_flagged(flag, n, index):
    """Write the indices of the flagged ones of n pixels; returns how many. No branch to mispredict.

    `flag` is padded with False to whole words.
    """
    words = flag.view(np.uint64)
    count = 0
    for word in range((n + 7) // 8):
        if words[word] != 0:
            for i in range(8 * word, 8 * word + 8):
                index[count] = i
                count += flag[i]
    return count


# Where the events of one block, setting and interval lie in the pool.
START, STOP = range(2)

# A level that an ideal pixel crosses, one column each: u is LEVEL_RISE above the interval's start
# there, of WHOLE_RISE over all of it.
LEVEL_RISE, WHOLE_RISE = range(2)


@jit
def fire_lines(
    todo, todo_words, count, setting, leader, interval, steps, start_us, length_us, pool, segment
):
    """Append the listed levels as events to the part of the pool of each setting that fires so."""
    for m in range(setting, leader.size):
        if leader[m] != setting:
            continue
        dt_us = steps[m, interval, DT_S] * 1e6
        first_us, whole_us = start_us[m, interval], length_us[m, interval]
        out = pool[segment[m, STOP] : segment[m, STOP] + count]
        for j in range(count):
            since_us = todo[LEVEL_RISE, j] * (dt_us / todo[WHOLE_RISE, j])
            out[j] = pack(since_us, first_us, whole_us, todo_words[j])
        segment[m, STOP] += count


@jit
def events_of_lines(
    flagged,
    u0,  # (len(flagged),) log intensity of the flagged pixels at the interval's ends; overwritten
    u1,
    drift,
    leaked,  # drift of the intervals since the band was set
    memory,
    C_on,
    C_off,
    darkest,
    brightest,
    setting,
    leader,
    interval,
    steps,
    start_us,
    length_us,
    position,
    todo,
    todo_words,
    pool,
    used,
    segment,  # (S, 2) out: where in the pool each setting's events start and stop
):
    """Fire the flagged ideal pixels over one interval, for all settings that fire alike.

    u is a straight line. What time it crosses a level is the only thing in which those settings
    differ. Returns how much of the pool is used, or -1 when it has not room enough.
    """
    # Settings that fire alike fill parts of the pool side by side, so these need an end.
    alike = 0
    for m in range(setting, leader.size):
        alike += leader[m] == setting
    room = pool.size - used
    if alike > 1:
        room = 0
        for k in range(flagged.size):
            i = flagged[k]
            room += np.int64(abs(u1[k] + drift - memory[i]) / min(C_on[i], C_off[i])) + 2
        if used + alike * room > pool.size:
            return -1
    for m in range(setting, leader.size):
        if leader[m] == setting:
            segment[m, START] = segment[m, STOP] = used
            used += room
    count = 0
    for k in range(flagged.size):
        i = flagged[k]
        level = memory[i]
        v_low, v_high = u0[k], u1[k] + drift
        sign = math.copysign(1.0, v_high - level)
        on, off = C_on[i], C_off[i]  # both read, so that the choice is no branch
        C = on if sign > 0.0 else off
        word = position[i] | (np.uint64(sign > 0.0) << POLARITY_SHIFT)
        while (v_high - level) * sign >= C:
            level += sign * C
            todo[LEVEL_RISE, count] = level - v_low
            todo[WHOLE_RISE, count] = v_high - v_low
            todo_words[count] = word
            count += 1
            room -= 1
            if room < 0:
                return -1
            if count == CROSSING_BATCH:
                fire_lines(
                    todo,
                    todo_words,
                    count,
                    setting,
                    leader,
                    interval,
                    steps,
                    start_us,
                    length_us,
                    pool,
                    segment,
                )
                count = 0
        memory[i] = level
        u0[k] = level + leaked - C_off[i]
        u1[k] = level + leaked + C_on[i]
    fire_lines(
        todo,
        todo_words,
        count,
        setting,
        leader,
        interval,
        steps,
        start_us,
        length_us,
        pool,
        segment,
    )
    for k in range(flagged.size):
        u0[k] = light_bound(u0[k], BOUND_MARGIN)
        u1[k] = light_bound(u1[k], -BOUND_MARGIN)
    for k in range(flagged.size):
        darkest[flagged[k]] = u0[k]
        brightest[flagged[k]] = u1[k]
    for m in range(setting, leader.size):
        if leader[m] == setting:
            used = segment[m, STOP]
    return used


@jit
def fire(todo, todo_words, count, start_us, length_us, pool, used):
    """Solve the listed crossings and append them to the pool as events; -1 when it is full."""
    if used + count > pool.size:
        return -1
    solve_crossings(todo, count)
    for k in range(count):
        since_us = todo[ROOT, k] * todo[US, k]
        pool[used + k] = pack(since_us, start_us, length_us, todo_words[k])
    return used + count


# A flagged pixel's v2 over an interval, one column each, in the terms of a crossing. WHOLE = a dt;
# SHAPED is where the transient ends or else the interval does, FLAT where before that v2's slope
# has its own turning point, or else SHAPED.
U_START, U_END, V1_START, V1_STOP, V2_START, V2_STOP, WHOLE, SHAPED, FLAT = range(9)
CURVE_START_V, CURVE_RISE, CURVE_A, CURVE_B, CURVE_SHORT, TURNS_BEFORE, TURNS_AFTER = range(9, 16)
CURVE_SIZE = 16


@jit
def describe_curves(curve, count, poles, drift):
    """From the state of the first `count` columns to their curves, in vectors."""
    u0, u1, v1, v2 = curve[U_START], curve[U_END], curve[V1_START], curve[V2_START]
    v1_end, v2_end, whole = curve[V1_STOP], curve[V2_STOP], curve[WHOLE]
    second = poles - 1.0
    for k in range(count):
        S = (u1[k] - u0[k]) / whole[k]
        to_v1, to_v2 = v1[k] - u0[k], v2[k] - u0[k]
        A = second * (to_v1 + S)
        B = to_v2 + poles * S
        leak = drift / whole[k]
        # v2' = v1 - v2 of two poles, u - v2 of one
        slope_start = second * to_v1 - to_v2 + leak
        slope_end = second * (v1_end[k] - u1[k]) - (v2_end[k] - u1[k]) + leak
        short = 1.0 if whole[k] < SHORT_X else 0.0
        rise = slope_start if short > 0.0 else S + leak
        shaped = min(whole[k], TRANSIENT)
        flat = (2.0 * to_v1 - to_v2) / A  # (2 A - B) / A of two poles
        inside = (second > 0.0) & (flat > 0.0) & (flat < shaped)
        flat = flat if inside else shaped
        slope_flat = v2_and_slopes_at(flat, 0.0, rise, A, B, short)[1] if inside else slope_end
        curve[V2_STOP, k] += drift
        curve[CURVE_START_V, k] = v2[k] if short > 0.0 else u0[k] - poles * S
        curve[CURVE_RISE, k] = rise
        curve[CURVE_A, k] = A
        curve[CURVE_B, k] = B
        curve[CURVE_SHORT, k] = short
        curve[SHAPED, k] = shaped
        curve[FLAT, k] = flat
        curve[TURNS_BEFORE, k] = slope_start * slope_flat < 0.0
        curve[TURNS_AFTER, k] = slope_flat * slope_end < 0.0


@jit
def events_of_curves(
    flagged,
    u0,
    u1,
    v1,
    v2,
    v1_end,
    v2_end,
    x,
    poles,
    drift,
    memory,
    C_on,
    C_off,
    dt_s,
    start_us,
    length_us,
    position,
    curve,
    todo,
    todo_words,
    pool,
    used,
):
    """Fire the flagged filtered pixels over one interval: v2 is a curve.

    The interval is cut where v2 turns, at most twice, and where its transient has died away; the
    levels that each monotone piece crosses are listed, and `fire` finds the times. Returns how much
    of the pool is used, or -1 when it is full.
    """
    for k in range(flagged.size):
        i = flagged[k]
        curve[U_START, k], curve[U_END, k] = u0[i], u1[i]
        curve[V1_START, k], curve[V1_STOP, k] = v1[i], v1_end[i]
        curve[V2_START, k], curve[V2_STOP, k] = v2[i], v2_end[i]
        curve[WHOLE, k] = each(x, i)
    describe_curves(curve, flagged.size, poles, drift)
    count = 0
    for k in range(flagged.size):
        i = flagged[k]
        start, rise = curve[CURVE_START_V, k], curve[CURVE_RISE, k]
        A, B, short = curve[CURVE_A, k], curve[CURVE_B, k], curve[CURVE_SHORT, k]
        whole, shaped, flat = curve[WHOLE, k], curve[SHAPED, k], curve[FLAT, k]
        # v2's slope has at most one turning point of its own; on both sides it is monotone.
        cut_0, cut_1 = 0.0, shaped
        if curve[TURNS_BEFORE, k] != 0.0:
            cut_0 = turning_point(0.0, flat, rise, A, B, short)
        if curve[TURNS_AFTER, k] != 0.0:
            cut_1 = turning_point(flat, shaped, rise, A, B, short)
        us = dt_s * 1e6 / whole
        slack = min(1.0, 1e6 / us) * 1e-9  # of the time constant 1/a, and of a second
        level = memory[i]
        low, v_low = 0.0, curve[V2_START, k]
        for high in (cut_0, cut_1, shaped, whole):
            if high <= low:
                continue
            at_end = high == whole
            v_high = curve[V2_STOP, k] if at_end else v2_at(high, start, rise, A, B, short)
            sign = math.copysign(1.0, v_high - level)
            on, off = C_on[i], C_off[i]  # both read, so that the choice is no branch
            C = on if sign > 0.0 else off
            word = position[i] | (np.uint64(sign > 0.0) << POLARITY_SHIFT)
            while (v_high - level) * sign >= C:
                if count == CROSSING_BATCH:
                    used = fire(todo, todo_words, count, start_us, length_us, pool, used)
                    count = 0
                    if used < 0:
                        return -1
                level += sign * C
                todo[START_V, count] = start
                todo[RISE, count] = rise
                todo[POLE_A, count] = A
                todo[POLE_B, count] = B
                todo[SHORT, count] = short
                todo[LEVEL, count] = level
                todo[LOW, count] = low
                todo[HIGH, count] = high
                todo[V_LOW, count] = v_low
                todo[V_HIGH, count] = v_high
                todo[US, count] = us
                todo[SLACK, count] = slack
                todo_words[count] = word
                count += 1
            low, v_low = high, v_high
        memory[i] = level
    return fire(todo, todo_words, count, start_us, length_us, pool, used)


@jit
def random_bits(seed, pixel, frame, draw):
    """64 random bits that depend on nothing but their four indices (SplitMix64, chained)."""
    bits = np.uint64(seed)
    for index in (np.uint64(pixel), np.uint64(frame), np.uint64(draw)):
        bits = (bits ^ index) + np.uint64(0x9E3779B97F4A7C15)
        bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        bits = bits ^ (bits >> np.uint64(31))
    return bits


@jit
def uniform(seed, pixel, frame, draw):
    """A random number in [0, 1)."""
    return np.float64(random_bits(seed, pixel, frame, draw) >> np.uint64(11)) * 2.0**-53


# Mean of a Poisson process that is drawn at once, and room for the draws of its events.
MOST_NOISE = 64.0
DRAWS_SHIFT = 20


@jit
def poisson(mean, left):
    """Number of events of a Poisson process by inversion: mean at most MOST_NOISE, left in [0, 1).

    `left` is what remains of the cumulated probability; rounding may leave 1e-16 of it.
    """
    if left < 1.0 - mean:  # exp(-mean) is not less: as a rule, nothing happens
        return 0
    probability = math.exp(-mean)
    count = 0
    while left >= probability and (count < mean or probability > 1e-18):
        left -= probability
        count += 1
        probability *= mean / count
    return count


@jit
def noise_events(
    n,
    u0,
    log_dark,
    electronics,
    hot_hz,
    seed,
    first_pixel,
    frame,
    dt_s,
    start_us,
    length_us,
    position,
    pool,
    begin,
    used,
):
    """Add a Poisson process of events of either polarity to n pixels over one interval.

    The rate is NOISE_HZ ((I + I_dark) / I_dark)^-NOISE_EXPONENT at the interval's start, and a hot
    pixel's own. The interval's events so far, from `begin`, and these are merged in raster order.
    Returns how much of the pool is used, or -1 when it is full.
    """
    signal_end = used
    noise_hz, exponent = electronics[NOISE_HZ], electronics[NOISE_EXPONENT]
    for i in range(n):
        rate_hz = hot_hz[i] if hot_hz.size > 0 else 0.0
        if noise_hz > 0.0:
            rate_hz += noise_hz * math.exp(-exponent * (u0[i] - log_dark))
        mean = rate_hz * dt_s
        # Parts of the interval are Poisson processes of their own, each of a mean that exp holds.
        parts = np.int64(mean * (1.0 / MOST_NOISE)) + 1
        part_us = dt_s * 1e6 / parts
        for part in range(parts):
            draw = part << DRAWS_SHIFT
            count = poisson(mean / parts, uniform(seed, first_pixel + i, frame, draw))
            for k in range(count):
                if used == pool.size:
                    return -1
                share = uniform(seed, first_pixel + i, frame, draw + 2 * k + 1)
                bit = random_bits(seed, first_pixel + i, frame, draw + 2 * k + 2) & np.uint64(1)
                word = (bit << POLARITY_SHIFT) | position[i]
                pool[used] = pack(part_us * (part + share), start_us, length_us, word)
                used += 1
    signal = pool[begin:signal_end].copy()
    noise = pool[signal_end:used].copy()
    j, k = 0, 0
    for out in range(begin, used):
        take_signal = k == noise.size or (
            j < signal.size and (signal[j] & PLACE_MASK) <= (noise[k] & PLACE_MASK)
        )
        if take_signal:
            pool[out] = signal[j]
            j += 1
        else:
            pool[out] = noise[k]
            k += 1
    return used


@jit
def log_of_flagged(flagged, radiance, dark, light, u):
    """u = log(I + I_dark) of the flagged pixels. Returns whether their radiance is radiance."""
    for k in range(flagged.size):
        light[k] = radiance[flagged[k]]
    return log_intensity(light[: flagged.size], dark, u)


DONE, FULL, BAD = range(3)


@jit
def advance_pixels(
    radiance,  # (F, height * width) linear radiance at the ends of F intervals
    dark,  # I_dark
    width,  # px
    pixel_start,
    pixel_stop,  # the pixels this call is for, in raster order
    block_px,
    u_start,  # (height * width,) log intensity at the first interval's start; updated
    v1,  # (S, height * width) or (S, 0) where no setting has a filter; updated
    v2,
    memory,  # (S, height * width); updated
    C_on,  # (S, height * width) contrast thresholds, or (S, 1) where all pixels have the same
    C_off,
    hot_hz,  # (S, height * width) noise of hot pixels, or (S, 0) where there are none
    electronics,  # (S, ELECTRONICS_SIZE)
    filtered,  # (S,) bool
    noisy,  # (S,) bool
    leader,  # (S,) the first setting that fires as this one does, but for the times: or itself
    seed,
    first_frame,  # number of the first interval since the start, for the draws
    steps,  # (S, F, STEP_SIZE)
    start_us,  # (S, F) how far each interval's start lies after a whole microsecond, or before it
    length_us,  # (S, F) int64: whole microseconds from an interval's start to its end, both rounded
    first_block,
    first_setting,  # where to go on after the pool was enlarged
    used,  # how much of the pool is used there
    pool,  # (capacity,) uint64 packed events
    segment,  # (blocks, S, F, 2) int64: where in the pool each one's events start and stop
):
    """Take a band of pixels through F frame intervals of S settings.

    Returns (outcome, block, setting, used). When the pool is FULL, nothing of that block and
    setting has been changed, and the call can be repeated from there with a larger pool. BAD is
    radiance that is negative or not finite.
    """
    F = radiance.shape[0]
    S = memory.shape[0]
    size = block_px
    every_u = filtered.any() or noisy.any()
    u = np.empty((F + 1, size))
    memory_now = np.empty(size)
    v1_now = np.empty((2, size))
    v2_now = np.empty((2, size))
    flag = np.zeros((size + 15) // 8 * 8, np.bool_)  # whole words, and one that ends the last
    index = np.empty(flag.size, np.int64)
    curve = np.empty((CURVE_SIZE, size))
    todo = np.empty((CROSSING_SIZE, CROSSING_BATCH))
    todo_words = np.empty(CROSSING_BATCH, np.uint64)
    position = np.empty(size, np.uint64)
    light = np.empty(size, radiance.dtype)
    u_flagged = np.empty((2, size))
    darkest = np.empty(size, np.float32)
    brightest = np.empty(size, np.float32)
    x_now = np.empty(size)
    e_now = np.empty(size)
    C_on_now = np.empty(size)
    C_off_now = np.empty(size)
    blocks = (pixel_stop - pixel_start + block_px - 1) // block_px
    for block in range(first_block, blocks):
        start = pixel_start + block * block_px
        n = min(block_px, pixel_stop - start)
        pixels = slice(start, start + n)
        flag[n:] = False
        y, x = start // width, start % width
        for i in range(n):
            position[i] = np.uint64(y) << ROW_SHIFT | np.uint64(x)
            x += 1
            if x == width:
                x = 0
                y += 1
        u[0, :n] = u_start[pixels]
        # Ideal pixels that are silent need no logarithm before the chunk's end.
        for f in range(0 if every_u else F - 1, F):
            if not log_intensity(radiance[f, pixels], dark, u[f + 1, :n]):
                return BAD, block, 0, 0
        for s in range(first_setting if block == first_block else 0, S):
            if leader[s] != s:
                continue
            used_before = used
            leaked = 0.0  # what memory_now has sunk by since the band of light was set
            memory_now[:n] = memory[s, pixels]
            if C_on.shape[1] == 1:
                C_on_now[:n] = C_on[s, 0]
                C_off_now[:n] = C_off[s, 0]
            else:
                C_on_now[:n] = C_on[s, pixels]
                C_off_now[:n] = C_off[s, pixels]
            if filtered[s]:
                v1_now[0, :n] = v1[s, pixels]
                v2_now[0, :n] = v2[s, pixels]
            else:
                band_of_light(n, memory_now, C_on_now, C_off_now, darkest, brightest)
            for f in range(F):
                now, end = f & 1, (f & 1) ^ 1
                dt_s = steps[s, f, DT_S]
                drift = electronics[s, LEAK_PER_S] * dt_s
                begin = used
                if filtered[s]:
                    before = u[f], u[f + 1], v1_now[now], v2_now[now]
                    poles, step = electronics[s, POLES], steps[s, f]
                    band = drift, memory_now, C_on_now, C_off_now
                    interval = dt_s, start_us[s, f], length_us[s, f]
                    work = position, curve, todo, todo_words, pool, used
                    after = v1_now[end], v2_now[end]
                    if electronics[s, LIGHT_A] > 0.0:
                        poles_to_end_in_own_light(
                            n, *before, dt_s, electronics[s], *after, x_now, e_now
                        )
                        flag_filtered(n, *before, v2_now[end], x_now, e_now, poles, *band, flag)
                        flagged = index[: list_flagged(flag, n, index)]
                        used = events_of_curves(
                            flagged, *before, *after, x_now, poles, *band, *interval, *work
                        )
                    else:
                        poles_to_end(n, *before, step, *after)
                        ends = v2_now[end], step[X], step[E]
                        flag_filtered(n, *before, *ends, poles, *band, flag)
                        flagged = index[: list_flagged(flag, n, index)]
                        used = events_of_curves(
                            flagged, *before, *after, step[X], poles, *band, *interval, *work
                        )
                else:
                    fade = exp(-leaked - drift)
                    flag_ideal(
                        radiance[f, pixels],
                        radiance.dtype.type(dark),
                        radiance.dtype.type(fade),
                        darkest,
                        brightest,
                        flag,
                    )
                    flagged = index[: list_flagged(flag, n, index)]
                    now_u, end_u = u_flagged[0, : flagged.size], u_flagged[1, : flagged.size]
                    if f == 0:
                        for k in range(flagged.size):
                            now_u[k] = u[0, flagged[k]]
                    else:
                        log_of_flagged(flagged, radiance[f - 1, pixels], dark, light, now_u)
                    if not log_of_flagged(flagged, radiance[f, pixels], dark, light, end_u):
                        return BAD, block, s, 0
                    used = events_of_lines(
                        flagged,
                        now_u,
                        end_u,
                        drift,
                        leaked,
                        memory_now,
                        C_on_now,
                        C_off_now,
                        darkest,
                        brightest,
                        s,
                        leader,
                        f,
                        steps,
                        start_us,
                        length_us,
                        position,
                        todo,
                        todo_words,
                        pool,
                        used,
                        segment[block, :, f],
                    )
                if used < 0:
                    return FULL, block, s, used_before
                if filtered[s]:
                    segment[block, s, f, START], segment[block, s, f, STOP] = begin, used
                if drift != 0.0:
                    memory_now[:n] -= drift
                    leaked += drift
                if noisy[s]:
                    used = noise_events(
                        n,
                        u[f],
                        math.log(dark),
                        electronics[s],
                        hot_hz[s, pixels],
                        seed,
                        start,
                        first_frame + f,
                        dt_s,
                        start_us[s, f],
                        length_us[s, f],
                        position,
                        pool,
                        begin,
                        used,
                    )
                    if used < 0:
                        return FULL, block, s, used_before
                    segment[block, s, f, STOP] = used
            memory[s, pixels] = memory_now[:n]
            if filtered[s]:
                v1[s, pixels] = v1_now[F & 1, :n]
                v2[s, pixels] = v2_now[F & 1, :n]
        u_start[pixels] = u[F, :n]
    return DONE, blocks, 0, used


@jit
def gather(pool, segment, s, f, words, used):
    """Append one setting's and interval's events in one band, in raster order. Returns used."""
    for block in range(segment.shape[0]):
        for j in range(segment[block, s, f, START], segment[block, s, f, STOP]):
            words[used] = pool[j]
            used += 1
    return used


@jit
def sort_by_time(words, other, interval_us, start_us, t_us, x, y, p):
    """Sort packed events by time, keeping raster order within a microsecond, and unpack them.

    A stable counting sort, digit by digit: one pass for intervals up to 4 ms. `other` is room for
    as many words again.
    """
    bits = 1
    while interval_us >> bits:
        bits += 1
    passes = (bits + 11) // 12
    digit_bits = np.uint64((bits + passes - 1) // passes)
    mask = (np.uint64(1) << digit_bits) - np.uint64(1)
    starts = np.empty((1 << digit_bits) + 1, np.int64)
    source, target = words, other
    for k in range(passes):
        shift = TIME_SHIFT + np.uint64(k) * digit_bits
        starts[:] = 0
        for word in source:
            starts[((word >> shift) & mask) + np.uint64(1)] += 1
        for digit in range(1, starts.size):
            starts[digit] += starts[digit - 1]
        for word in source:
            digit = (word >> shift) & mask
            target[starts[digit]] = word
            starts[digit] += 1
        source, target = target, source
    for k in range(source.size):
        word = source[k]
        t_us[k] = start_us + np.int64(word >> TIME_SHIFT)
        x[k] = word & COORDINATE_MASK
        y[k] = (word >> ROW_SHIFT) & COORDINATE_MASK
        p[k] = np.int8((word >> POLARITY_SHIFT) & np.uint64(1)) * 2 - 1


@jit
def outside_refractory(t_us, x, y, refractory_us, ready_us, keep):
    """Mark which of a pixel's events come at least the refractory period after its last kept one.

    ready_us, (height, width) int64, is when each pixel can fire again; updated.
    """
    latest = np.iinfo(np.int64).max - refractory_us
    for k in range(t_us.size):
        keep[k] = t_us[k] >= ready_us[y[k], x[k]]
        if keep[k]:
            ready_us[y[k], x[k]] = min(t_us[k], latest) + refractory_us
