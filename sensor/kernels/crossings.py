"""When the voltage within an interval crosses a level: Eq. (1) solved for t."""

from __future__ import annotations

import math
from typing import NamedTuple

from sensor.kernels.elementary import exp_parts, inlined, jit

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
# Both are start + rise y - short A y^2 + (B + A y) decay(y, short). What the memory leaks comes
# on top of the slope.


class Curve(NamedTuple):
    """v2 of one pixel within an interval."""

    start: float
    rise: float
    A: float
    B: float
    short: float  # 1 in the short form, 0 in the long


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
def v2_at(y, curve):
    """v2 at y = a t."""
    start, rise, A, B, short = curve
    return start + y * (rise - short * A * y) + (B + A * y) * decay(y, short)


@inlined
def v2_and_slopes_at(y, curve):
    """v2 and its first three derivatives by y at y = a t."""
    start, rise, A, B, short = curve
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
def turning_point(low, high, curve):
    """Root of v2's slope between low and high, where it changes its sign exactly once.

    Halley's method, kept inside a shrinking bracket, which is halved where a step is outside of it
    or is not half as long as the one before. v2 is flat here: an error of 1e-8 in the root leaves
    one of 1e-16 in v2.
    """
    slope_low = v2_and_slopes_at(low, curve)[1]
    slope_high = v2_and_slopes_at(high, curve)[1]
    falling = slope_low > slope_high
    close = 1e-4 * min(high - low, 1.0)
    moved = high - low
    y = low + moved * min(max(slope_low / (slope_low - slope_high), 0.0), 1.0)
    for _ in range(200):
        _, slope, curvature, third = v2_and_slopes_at(y, curve)
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
def halley(y, curve, level, slack):
    """One step of Halley's method towards v2(y) = level. Returns (next y, error, near).

    Near means that the next y is off by less than the slack. With d = error / slope, about the
    distance left, the step leaves at most about d^3 (bend^2 + |third|), the second and the third
    derivative over the first. The step's own length would not do: it is short near any turn of v2,
    wherever the level is.
    """
    v, slope, curvature, third = v2_and_slopes_at(y, curve)
    error = v - level
    inverse = 1.0 / slope
    distance = error * inverse
    bend = curvature * inverse
    better = y - distance / (1.0 - 0.5 * distance * bend)
    left = abs(distance * distance * distance) * (bend * bend + abs(third * inverse))
    return better, error, (abs(distance) < 0.01) & (left < slack)


@jit
def crossing(curve, level, low, high, v_low, v_high, slack):
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
        better, error, near = halley(y, curve, level, slack)
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
        curve = Curve(start[k], rise[k], A[k], B[k], short[k])
        y = low[k] + (high[k] - low[k]) * ((level[k] - v_low[k]) / (v_high[k] - v_low[k]))
        better, _, _ = halley(y, curve, level[k], slack[k])
        y = min(max(better, low[k]), high[k])
        better, _, _ = halley(y, curve, level[k], slack[k])
        y = min(max(better, low[k]), high[k])
        better, _, near = halley(y, curve, level[k], slack[k])
        # A root is a number of at least 0: less marks what is still to be done.
        root[k] = min(max(better, low[k]), high[k]) if near else -1.0
    for k in range(count):
        if not root[k] >= 0.0:
            curve = Curve(start[k], rise[k], A[k], B[k], short[k])
            root[k] = crossing(curve, level[k], low[k], high[k], v_low[k], v_high[k], slack[k])
