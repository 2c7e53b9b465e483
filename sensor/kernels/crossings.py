"""Solve Eq. (1) for t: the times at which the voltage crosses a level within an interval."""

from __future__ import annotations

import math
from typing import NamedTuple

from sensor.kernels.elementary import exp_parts, inlined, jit

# A transient is negligible beyond y = a t = TRANSIENT: y^2 e^{-y} < 1e-24.
TRANSIENT = 64.0

# Largest a dt of a curve in the short form.
SHORT_X = 0.25

# v2 within an interval as a function of y = a t. With S = s/a and k poles, the long form is
#
#   v2(y) = (u0 - k S) + S y + (B + A y) e^{-y}, A = (k - 1) (v1 - u0 + S), B = v2 - u0 + k S
#
# and the short form, for small a dt, where the terms in S would cancel, is
#
#   v2(y) = v2 + v2'(0) y - A y^2 + (B + A y) (e^{-y} - 1 + y).
#
# Both are start + rise y - short A y^2 + (B + A y) decay(y, short). Leakage of the memory adds to
# the slope.


class Curve(NamedTuple):
    """v2 of one pixel within an interval."""

    start: float
    rise: float
    A: float
    B: float
    short: float  # 1 in the short form, 0 in the long


class Piece(NamedTuple):
    """A range of y in which v2 is monotone, with v2 and its slope at both ends.

    Rough slopes only cost time.
    """

    low: float
    high: float
    v_low: float
    v_high: float
    slope_low: float
    slope_high: float


# Rows of `Work.todo`, one column for each crossing to solve: the `Curve`, the level, the `Piece`
# with the crossing, the length of y = 1 in microseconds, and the allowed error of y. Output: ROOT,
# and whether it is within the slack.
START_V, RISE, POLE_A, POLE_B, SHORT, LEVEL, LOW, HIGH, V_LOW, V_HIGH = range(10)
SLOPE_LOW, SLOPE_HIGH, US, SLACK, ROOT, SOLVED = range(10, 16)
CROSSING_SIZE = 16
# Rows of `Work.todo` in `solve_turns`: the slope falls across the bracket; length of the latest
# step; length of a step that is the last; output: v2 at ROOT.
FALLING, MOVED, CLOSE, V_ROOT = LEVEL, US, SLACK, V_HIGH
CROSSING_BATCH = 520  # no power of two, so that the rows do not share lines of the cache


@inlined
def decay(y, short):
    """Return e^{-y}, or e^{-y} - 1 + y to full precision.

    Parameters
    ----------
    y
        a t; less than ln(2) / 2 in the short form.
    short
        0 for the first, 1 for the second.
    """
    scale, r, tail = exp_parts(-y)
    return scale * (tail + (1.0 - short) * (1.0 + r))


@inlined
def v2_at(y, curve):
    """Return v2 at y.

    Parameters
    ----------
    y
        a t.
    curve
        `Curve` of the pixel.
    """
    start, rise, A, B, short = curve
    return start + y * (rise - short * A * y) + (B + A * y) * decay(y, short)


@inlined
def v2_and_slopes_at(y, curve):
    """Return v2 and its first four derivatives with respect to y.

    Parameters
    ----------
    y, curve
        As in `v2_at`.
    """
    start, rise, A, B, short = curve
    E = decay(y, short)
    E1 = short * y - E
    E2 = short - E1
    w = B + A * y
    square = short * A
    v = start + y * (rise - square * y) + w * E
    slope = rise - 2.0 * square * y + A * E + w * E1
    curvature = -2.0 * square + 2.0 * A * E1 + w * E2
    return v, slope, curvature, (3.0 * A - w) * E2, (w - 4.0 * A) * E2


@inlined
def towards_turn(low, high, y, moved, close, falling, curve):
    """Do one step towards the root of the slope of v2, by Halley's method or bisection.

    Parameters
    ----------
    low, high, y
        Bracket of the root, and a point in it.
    moved, close
        Length of the step before, and the length of a step that is the last.
    falling
        The slope falls across the bracket.
    curve
        `Curve` of the pixel.

    Returns
    -------
    low, high, y, moved
        The same as before the step if the step before was the last.
    """
    _, slope, curvature, third, _ = v2_and_slopes_at(y, curve)
    before = (slope > 0.0) == falling
    next_low, next_high = y if before else low, high if before else y
    better = y - 2.0 * slope * curvature / (2.0 * curvature * curvature - slope * third)
    good = (next_low <= better) & (better <= next_high) & (abs(better - y) <= 0.5 * moved)
    better = better if good else 0.5 * (next_low + next_high)
    last = moved < close
    return (
        low if last else next_low,
        high if last else next_high,
        y if last else better,
        moved if last else abs(better - y),
    )


_VECTOR_STEPS = 4
_FURTHER_STEPS = 200  # of what has not converged: bisection ends long before
MAX_TURN_STEPS = _VECTOR_STEPS + _FURTHER_STEPS


@jit
def solve_turns(todo, count):
    """Solve for the roots of the slope of v2 between LOW and HIGH, where its sign changes once.

    The method is Halley's inside a shrinking bracket, with bisection where a step leaves the
    bracket or is more than half as long as the one before. v2 is flat at the root: an error of 1e-8
    in y is one of 1e-16 in v2. Few need more than the four steps of the vectorized loops.

    Parameters
    ----------
    todo
        (CROSSING_SIZE, n) with curves, LOW and HIGH; these two are overwritten; the rows ROOT and
        V_ROOT are the output.
    count
        Number of turning points.
    """
    start, rise, A, B, short = todo[START_V], todo[RISE], todo[POLE_A], todo[POLE_B], todo[SHORT]
    low, high, root = todo[LOW], todo[HIGH], todo[ROOT]
    falling, moved, close = todo[FALLING], todo[MOVED], todo[CLOSE]
    for k in range(count):
        curve = Curve(start[k], rise[k], A[k], B[k], short[k])
        a, b = low[k], high[k]
        slope_a = v2_and_slopes_at(a, curve)[1]
        slope_b = v2_and_slopes_at(b, curve)[1]
        falls = slope_a > slope_b
        step = b - a
        last = 1e-4 * min(step, 1.0)
        y = a + step * min(max(slope_a / (slope_a - slope_b), 0.0), 1.0)
        root[k], moved[k], close[k] = y, step, last
        falling[k] = 1.0 if falls else 0.0
    for _ in range(_VECTOR_STEPS):
        for k in range(count):
            curve = Curve(start[k], rise[k], A[k], B[k], short[k])
            low[k], high[k], root[k], moved[k] = towards_turn(
                low[k], high[k], root[k], moved[k], close[k], falling[k] == 1.0, curve
            )
    for k in range(count):
        if moved[k] >= close[k]:
            curve = Curve(start[k], rise[k], A[k], B[k], short[k])
            a, b, y, step = low[k], high[k], root[k], moved[k]
            for _ in range(_FURTHER_STEPS):
                a, b, y, step = towards_turn(a, b, y, step, close[k], falling[k] == 1.0, curve)
                if step < close[k]:
                    break
            root[k] = y
    at_root = todo[V_ROOT]
    for k in range(count):
        at_root[k] = v2_at(root[k], Curve(start[k], rise[k], A[k], B[k], short[k]))


@inlined
def householder(y, curve, level, slack):
    """Do one step of Householder's third-order method towards v2(y) = level.

    With h the step of Newton's method and bend, twist and fourth the higher derivatives divided by
    the first, the error after the step is at most about h^4 (|bend|^3 + |bend twist| + |fourth|).
    The length of the step cannot tell this: it is short near any turning point of v2.

    Parameters
    ----------
    y, curve
        As in `v2_at`.
    level, slack
        The level, and the allowed error of y.

    Returns
    -------
    better, error, near
        Next y; v2(y) - level; whether the next y is within the slack.
    """
    v, slope, curvature, third, fourth = v2_and_slopes_at(y, curve)
    error = v - level
    inverse = 1.0 / slope
    h = -error * inverse
    bend = curvature * inverse
    twist = third * inverse
    better = y + h * (1.0 + 0.5 * h * bend) / (1.0 + h * (bend + h * twist * (1.0 / 6.0)))
    square = h * h
    left = square * square * (abs(bend * bend * bend) + abs(bend * twist) + abs(fourth * inverse))
    return better, error, (abs(h) < 0.05) & (left < slack)


@inlined
def first_guess(level, piece):
    """Return the y at which v2 roughly crosses a level.

    The curve is first the parabola through both ends with the mean curvature, then, by one step of
    Halley's method, the cubic with the slopes of both ends.

    Parameters
    ----------
    level, piece
        The level, and a `Piece` that crosses it.
    """
    low, high, v_low, v_high, slope_low, slope_high = piece
    length = high - low
    rise, climb = v_high - v_low, level - v_low
    first, last = slope_low * length, slope_high * length
    bow = 0.5 * (last - first)
    linear = rise - bow
    root = math.copysign(math.sqrt(max(linear * linear + 4.0 * bow * climb, 0.0)), rise)
    share = min(max(2.0 * climb / (linear + root), 0.0), 1.0)
    square, cube = 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
    error = share * (first + share * (square + share * cube)) - climb
    slope = first + share * (2.0 * square + share * 3.0 * cube)
    curvature = 2.0 * square + share * 6.0 * cube
    share -= 2.0 * error * slope / (2.0 * slope * slope - error * curvature)
    return low + length * min(max(share, 0.0), 1.0)


@jit
def crossing(curve, level, piece, slack, y, plain):
    """Return the y of the piece at which v2 crosses the level; always converges.

    The first steps are those of `solve_crossings`. If they do not reach the root, the search starts
    again, with the bracket and the bisection of `solve_turns`, where the chord crosses the level
    or, if that is earlier, where an exponential tail would: along a tail, the steps are short.

    Parameters
    ----------
    curve, level, piece
        `Curve` of the pixel, the level, and the `Piece`.
    slack
        Allowed error of y.
    y, plain
        Start of the first steps, and their number.
    """
    low, high, v_low, v_high, _, _ = piece
    rising = v_high > v_low
    moved = high - low
    for step in range(plain + _FURTHER_STEPS):
        if step == plain:
            share = (level - v_low) / (v_high - v_low)
            if low >= TRANSIENT:  # a straight line
                return low + (high - low) * min(max(share, 0.0), 1.0)
            y = low + min(moved * share, -math.log1p(-share) if share < 1.0 else moved)
            y = min(max(y, low), high)
        better, error, near = householder(y, curve, level, slack)
        if step < plain:
            y = min(max(better, low), high)
        else:
            if (error < 0.0) == rising:
                low = y
            else:
                high = y
            if not (low <= better <= high and abs(better - y) <= 0.5 * moved):
                better = 0.5 * (low + high)
                near = False
            moved = abs(better - y)
            y = better
            near |= high - low < slack
        if near:
            break
    return y


PLAIN_STEPS = 3
_FEW = 8  # a vectorized step pays if more than one in _FEW crossings needs it


@jit
def solve_crossings(todo, count):
    """Solve the listed crossings by Householder's method in vectorized loops.

    Each gets up to PLAIN_STEPS steps, until one is within the slack. `crossing` does the rest of
    these steps one crossing at a time once only few need them, and it solves those that no step
    brings within the slack, near a turning point of v2 or far down a tail. So a root does not
    depend on the other crossings of the list.

    Parameters
    ----------
    todo
        (CROSSING_SIZE, n); the row ROOT is the output.
    count
        Number of crossings.
    """
    start, rise, A, B, short = todo[START_V], todo[RISE], todo[POLE_A], todo[POLE_B], todo[SHORT]
    low, high, v_low, v_high = todo[LOW], todo[HIGH], todo[V_LOW], todo[V_HIGH]
    slope_low, slope_high = todo[SLOPE_LOW], todo[SLOPE_HIGH]
    level, slack, root, solved = todo[LEVEL], todo[SLACK], todo[ROOT], todo[SOLVED]
    for k in range(count):
        piece = Piece(low[k], high[k], v_low[k], v_high[k], slope_low[k], slope_high[k])
        root[k] = first_guess(level[k], piece)
        solved[k] = 0.0
    done = 0
    left = count
    while left * _FEW > count and done < PLAIN_STEPS:
        left = 0
        for k in range(count):
            curve = Curve(start[k], rise[k], A[k], B[k], short[k])
            better, _, near = householder(root[k], curve, level[k], slack[k])
            before = solved[k] > 0.0
            root[k] = root[k] if before else min(max(better, low[k]), high[k])
            solved[k] = 1.0 if before | near else 0.0
            left += 0 if before | near else 1
        done += 1
    for k in range(count):
        if solved[k] == 0.0:
            curve = Curve(start[k], rise[k], A[k], B[k], short[k])
            piece = Piece(low[k], high[k], v_low[k], v_high[k], slope_low[k], slope_high[k])
            root[k] = crossing(curve, level[k], piece, slack[k], root[k], PLAIN_STEPS - done)
