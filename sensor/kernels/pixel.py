"""One pixel over one interval: the same equations without the arrays of a block, for a GPU.

`advance` goes through blocks of pixels, in loops over arrays that LLVM vectorizes. On a GPU each
thread has one pixel, and keeps its state and its curve in registers. The functions count the events
of the pixel, or write them too; both give the same number.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.comparator import PIECES
from sensor.kernels.crossings import (
    MAX_TURN_STEPS,
    PLAIN_STEPS,
    SHORT_X,
    TRANSIENT,
    Curve,
    Piece,
    crossing,
    first_guess,
    towards_turn,
    v2_and_slopes_at,
    v2_at,
)
from sensor.kernels.elementary import jit
from sensor.kernels.noise import (
    DRAWS_SHIFT,
    HOT_DRAWS,
    MAX_NOISE,
    Rate,
    poisson,
    random_bits,
    shot_noise_rate,
    time_in_interval,
    uniform,
)
from sensor.kernels.packing import POLARITY_SHIFT, TIME_SHIFT, pack
from sensor.kernels.photoreceptor import step_of, within_float
from sensor.kernels.silence import Ends, may_fire


class Comparator(NamedTuple):
    """The comparator of a pixel at the start of an interval."""

    memory: float
    C_on: float
    C_off: float


class Span(NamedTuple):
    """One frame interval on the clock of the events that are written together."""

    dt_s: float
    drift: float  # fall of the memory over the interval by leakage, log units
    start_us: float  # exact start minus rounded start
    length_us: int  # rounded end minus rounded start
    since_us: int  # rounded start since the clock's start


class Filter(NamedTuple):
    """The photoreceptor of a setting, as in `Settings`."""

    poles: float
    light_a: float
    light_0: float


class Out(NamedTuple):
    """Where a pixel writes its events."""

    place: int  # packed row and column
    words: NDArray[np.uint64]  # (N,) uint64 packed events
    at: int  # index of the next one
    writes: bool  # False only counts


@jit
def put(out, k, since_us, polarity, span):
    """Write the k-th event of a pixel.

    Parameters
    ----------
    out, k
        `Out`, and number of events before.
    since_us, polarity, span
        Time since the start of the interval, 1 for brighter or 0, and `Span`.
    """
    low = np.uint64(polarity) << POLARITY_SHIFT | np.uint64(out.place)
    word = pack(since_us, span.start_us, span.length_us, low)
    if out.at + k < out.words.size:  # always, unless rounding were to differ from the count's
        out.words[out.at + k] = word + (np.uint64(span.since_us) << TIME_SHIFT)


@jit
def fire_line(u0, u1, comparator, span, out):
    """Fire an ideal pixel over one interval, Eq. (1) on a straight line.

    Parameters
    ----------
    u0, u1
        Log intensity at both ends.
    comparator, span, out
        `Comparator`, `Span` and `Out`.

    Returns
    -------
    memory, count
        The memory at the end, without the interval's leakage, and the number of events.
    """
    level, v_high = comparator.memory, u1 + span.drift
    up = v_high > level
    C = comparator.C_on if up else comparator.C_off
    count = 0
    if abs(v_high - level) < C:
        return level, count
    step = C if up else -C
    scale = span.dt_s * 1e6 / (v_high - u0)
    while abs(v_high - level) >= C:
        level += step
        if out.writes:
            put(out, count, (level - u0) * scale, up, span)
        count += 1
    return level, count


@jit
def turn_between(low, high, curve):
    """Return the root of the slope of v2 between two y, where its sign changes once.

    The steps are those of `solve_turns`.

    Parameters
    ----------
    low, high, curve
        Bracket, and `Curve`.
    """
    slope_low = v2_and_slopes_at(low, curve)[1]
    slope_high = v2_and_slopes_at(high, curve)[1]
    falling = slope_low > slope_high
    moved = high - low
    close = 1e-4 * min(moved, 1.0)
    y = low + moved * min(max(slope_low / (slope_low - slope_high), 0.0), 1.0)
    for _ in range(MAX_TURN_STEPS):
        low, high, y, moved = towards_turn(low, high, y, moved, close, falling, curve)
        if moved < close:
            break
    return y


@jit
def fire_curve(ends, v1_end, x, poles, comparator, span, out):
    """Fire a filtered pixel over one interval, Eq. (1) on the exact voltage.

    The interval is split into pieces in which v2 is monotone: at its turning points, at most two,
    and at the end of its transient, as in `events_of_curves`.

    Parameters
    ----------
    ends, v1_end
        `Ends`, and the output of the first pole at the end.
    x, poles
        a dt, and 1 or 2.
    comparator, span, out
        `Comparator`, `Span` and `Out`.

    Returns
    -------
    memory, count
        As for `fire_line`.
    """
    u0, u1, v1, v2, drift = ends.u0, ends.u1, ends.v1, ends.v2, span.drift
    second = poles - 1.0
    S = (u1 - u0) / x
    to_v1, to_v2 = v1 - u0, v2 - u0
    A = second * (to_v1 + S)
    B = to_v2 + poles * S
    leak = drift / x
    slope_start = second * to_v1 - to_v2 + leak
    slope_end = second * (v1_end - u1) - (ends.v2_end - u1) + leak
    v_end = ends.v2_end + drift
    is_short = x < SHORT_X
    curve = Curve(
        v2 if is_short else u0 - poles * S,
        slope_start if is_short else S + leak,
        A,
        B,
        1.0 if is_short else 0.0,
    )
    shaped = min(x, TRANSIENT)
    flat = (2.0 * to_v1 - to_v2) / A  # (2 A - B) / A of two poles
    inside = (second > 0.0) & (flat > 0.0) & (flat < shaped)
    flat = flat if inside else shaped
    slope_flat = v2_and_slopes_at(flat, curve)[1] if inside else slope_end
    straight = shaped == x
    v_shaped = v_end if straight else curve.start + shaped * curve.rise
    # Ends of the pieces, and v2 there; empty pieces end where they start.
    cut_0, v_cut_0 = 0.0, v2
    cut_1, v_cut_1 = shaped, v_shaped
    turns_before, turns_after = slope_start * slope_flat < 0.0, slope_flat * slope_end < 0.0
    if turns_before:
        cut_0 = turn_between(0.0, flat, curve)
        v_cut_0 = v2_at(cut_0, curve)
    if turns_after:
        cut_1 = turn_between(flat, shaped, curve)
        v_cut_1 = v2_at(cut_1, curve)
    us = span.dt_s * 1e6 / x
    slack = min(1.0, 1e6 / us) * 1e-9  # of the time constant 1/a, and of a second
    level, count = comparator.memory, 0
    low, v_low, slope_low = 0.0, v2, slope_start
    for piece in range(0 if turns_before or turns_after or not straight else PIECES - 1, PIECES):
        if piece == 0:
            high, v_high = cut_0, v_cut_0
        elif piece == 1:
            high, v_high = cut_1, v_cut_1
        elif piece == 2:
            high, v_high = shaped, v_shaped
        else:
            high, v_high = x, v_end
        if high > low:
            slope_high = 0.0 if high < shaped else slope_end
            up = v_high > level
            C = comparator.C_on if up else comparator.C_off
            move = C if up else -C
            while abs(v_high - level) >= C:
                level += move
                if out.writes:
                    bracket = Piece(low, high, v_low, v_high, slope_low, slope_high)
                    guess = first_guess(level, bracket)
                    y = crossing(curve, level, bracket, slack, guess, PLAIN_STEPS)
                    put(out, count, y * us, up, span)
                count += 1
            low, v_low, slope_low = high, v_high, slope_high
    return level, count


@jit
def step_in_own_light(u0, u1, filter, dt_s):
    """Return the `Step` of a pixel whose cutoff depends on the light.

    Parameters
    ----------
    u0, u1
        Log intensity at both ends.
    filter, dt_s
        `Filter`, and the length of the interval, s.
    """
    light = math.exp(0.5 * (u0 + u1)) + filter.light_0
    x = within_float(filter.light_a * dt_s * light)
    return step_of(x, math.exp(-x), -math.expm1(-x) / x, filter.poles == 2.0)


@jit
def advance_filtered(u0, u1, v1, v2, filter, step, fires, comparator, span, out):
    """Advance a filtered pixel over one interval, and fire it.

    Parameters
    ----------
    u0, u1
        Log intensity at both ends.
    v1, v2
        Outputs of the poles at the start.
    filter, step
        `Filter`, and the `Step` of pixels whose cutoff does not depend on the light.
    fires
        False if it is known that the pixel does not fire.
    comparator, span, out
        `Comparator`, `Span` and `Out`.

    Returns
    -------
    v1, v2, memory, count
        State at the end, without the interval's leakage, and the number of events.
    """
    if filter.light_a > 0.0:
        step = step_in_own_light(u0, u1, filter, span.dt_s)
    v1_end = step.e * v1 + step.v1_u0 * u0 + step.v1_u1 * u1
    v2_end = step.e * v2 + step.v2_v1 * v1 + step.v2_u0 * u0 + step.v2_u1 * u1
    memory, count = comparator.memory, 0
    ends = Ends(u0, u1, v1, v2, v2_end, memory, comparator.C_on, comparator.C_off)
    if fires and may_fire(ends, step.x, step.e, span.drift, filter.poles):
        memory, count = fire_curve(ends, v1_end, step.x, filter.poles, comparator, span, out)
    return v1_end, v2_end, memory, count


@jit
def fire_poisson(rate, seed, pixel, frame, first_draw, span, out, count):
    """Fire the events of a Poisson process of one pixel over one interval, as `add_poisson`.

    Parameters
    ----------
    rate
        `Rate`.
    seed, pixel, frame, first_draw
        Indices of the first random number.
    span, out, count
        `Span`, `Out`, and number of events before.

    Returns
    -------
    int
        Number of events, with those before.
    """
    parts = np.int64(rate.mean * (1.0 / MAX_NOISE)) + 1
    for part in range(parts):
        draw = first_draw + (part << DRAWS_SHIFT)
        fired = poisson(rate.mean / parts, uniform(seed, pixel, frame, draw))
        if out.writes:
            for k in range(fired):
                share = (part + uniform(seed, pixel, frame, draw + 2 * k + 1)) / parts
                bit = random_bits(seed, pixel, frame, draw + 2 * k + 2) & np.uint64(1)
                since_us = span.dt_s * 1e6 * time_in_interval(share, rate)
                put(out, count + k, since_us, bit, span)
        count += fired
    return count


@jit
def fire_noise(source, log_dark, u0, u1, pixel, frame, span, out, count):
    """Fire the noise of one pixel over one interval, as `noise_events`.

    Parameters
    ----------
    source
        `NoiseSource`, with `hot_hz` of all pixels.
    log_dark
        Logarithm of I_dark; of no effect without shot noise.
    u0, u1
        Log intensity at both ends.
    pixel, frame
        Index of the pixel, and of the interval since the first frame.
    span, out, count
        As in `fire_poisson`.

    Returns
    -------
    int
        As for `fire_poisson`.
    """
    if source.dark_hz > 0.0:
        rate = shot_noise_rate(source, log_dark, u0, u1, span.dt_s)
        count = fire_poisson(rate, source.seed, pixel, frame, 0, span, out, count)
    if source.hot_hz.size > 0 and source.hot_hz[pixel] > 0.0:
        rate = Rate(source.hot_hz[pixel] * span.dt_s, 0.0, False)
        count = fire_poisson(rate, source.seed, pixel, frame, HOT_DRAWS, span, out, count)
    return count
