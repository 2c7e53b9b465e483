"""The comparator, Eq. (1): find the levels that the flagged pixels cross, and fire the events."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.crossings import (
    CROSSING_BATCH,
    HIGH,
    LEVEL,
    LOW,
    POLE_A,
    POLE_B,
    RISE,
    ROOT,
    SHORT,
    SHORT_X,
    SLACK,
    SLOPE_HIGH,
    SLOPE_LOW,
    START_V,
    TRANSIENT,
    US,
    V_HIGH,
    V_LOW,
    V_ROOT,
    Curve,
    solve_crossings,
    solve_turns,
    v2_and_slopes_at,
)
from sensor.kernels.elementary import allocating, inlined, jit
from sensor.kernels.packing import FULL, POLARITY_SHIFT, START, STOP, pack
from sensor.kernels.silence import light_bounds

# Rows of `Work.curve` for ideal pixels, one column for each flagged one: level of the comparator at
# the start and the end of the interval, its move at each event, rise of u over the interval,
# microseconds for each unit of that rise, thresholds, factors
# `fall` and `rise` of the light, and scratch memory.
LEVEL_0, LEVEL_END, MOVE, WHOLE_RISE, SCALE, ON, OFF, FALL, RISE_TO, LEVEL_NOW = range(10)
SLOTS = 4  # events of an ideal pixel and interval that are written without a branch
FEW_SLOTS = 2  # the same where pixels fire less on average


class Work(NamedTuple):
    """Memory for the crossings of a block, and the pool that receives the events."""

    position: NDArray[np.uint64]  # (block,) packed row and column
    curve: NDArray[np.float64]  # (CURVE_SIZE, block)
    todo: NDArray[np.float64]  # (CROSSING_SIZE, CROSSING_BATCH)
    todo_of: NDArray[np.uint64]  # (CROSSING_BATCH,) column in `curve`
    todo_words: NDArray[np.uint64]  # (CROSSING_BATCH,) polarity and position
    words: NDArray[np.uint64]  # (block,) the same of the flagged ideal pixels
    fired: NDArray[np.int64]  # (block,) events of these pixels
    slots: NDArray[np.uint64]  # (SLOTS, block) their first events, packed
    pool: NDArray[np.uint64]  # (capacity,) packed events


class Lines(NamedTuple):
    """Log intensity of the flagged ideal pixels over one interval, straight lines in time."""

    u0: NDArray[np.float64]  # (flagged,) at the start of the interval; overwritten
    u1: NDArray[np.float64]  # and at its end; overwritten
    drift: float  # fall of the memory over the interval
    leaked: float  # fall of the memory since `set_light_band`


class Alike(NamedTuple):
    """Settings with equal events except for the times, over one interval."""

    setting: int  # the first of these settings
    leader: NDArray[np.int64]  # (S,) as in `Settings`
    dt_s: NDArray[np.float64]  # (S,) as in `Interval`
    start_us: NDArray[np.float64]
    length_us: NDArray[np.int64]
    segment: NDArray[np.int64]  # (S, 2) output: START and STOP of each setting in the pool


@inlined
def climb(level, step, C, v_high):
    """Return the level after the next event on the way to v_high, or the same level without one.

    Parameters
    ----------
    level, step
        The comparator's level, and its next move, C up or down.
    C, v_high
        Contrast threshold, and the voltage at the end.
    """
    return level + step if abs(v_high - level) >= C else level


@jit
def count_lines(flagged, lines, comparators, work):
    """Count the events of each flagged ideal pixel, and describe them in `work.curve`.

    The first loop counts up to SLOTS events without a branch, the second loop the others.

    Parameters
    ----------
    flagged, lines, comparators, work
        As in `events_of_lines`.

    Returns
    -------
    int
        Number of events.
    """
    memory, C_on, C_off, alike = comparators
    level_0, level_end, move = work.curve[LEVEL_0], work.curve[LEVEL_END], work.curve[MOVE]
    on, off, whole = work.curve[ON], work.curve[OFF], work.curve[WHOLE_RISE]
    position, fired, words = work.position, work.fired, work.words
    u0, u1, drift = lines.u0, lines.u1, lines.drift
    for k in range(flagged.size):
        i = flagged[k]
        level_0[k], words[k] = memory[i], position[i]
    if alike:
        for k in range(flagged.size):
            on[k], off[k] = C_on[0], C_off[0]
    else:
        for k in range(flagged.size):
            on[k], off[k] = C_on[flagged[k]], C_off[flagged[k]]
    total = np.int64(0)
    most = np.int64(0)
    for k in range(u0.size):
        level = level_0[k]
        v_high = u1[k] + drift
        up = v_high > level
        C = on[k] if up else off[k]
        step = C if up else -C
        level_1 = climb(level, step, C, v_high)
        level_2 = climb(level_1, step, C, v_high)
        level_3 = climb(level_2, step, C, v_high)
        end = climb(level_3, step, C, v_high)
        n = np.int64(level_1 != level) + np.int64(level_2 != level_1)
        n += np.int64(level_3 != level_2) + np.int64(end != level_3)
        level_end[k], move[k], whole[k] = end, step, v_high - u0[k]
        words[k] |= np.uint64(up) << POLARITY_SHIFT
        fired[k] = n
        total += n
        most = max(most, n)
    if most == SLOTS:
        for k in range(flagged.size):
            if fired[k] == SLOTS:
                v_high, C = u1[k] + drift, abs(move[k])
                while abs(v_high - level_end[k]) >= C:
                    level_end[k] += move[k]
                    fired[k] += 1
                    total += 1
    return total


@jit
def time_lines(u0, dt_us, start_us, length_us, slots, work):
    """Compute the first events of each flagged ideal pixel in vectorized loops.

    Parameters
    ----------
    u0
        (flagged,) log intensity at the start of the interval.
    dt_us, start_us, length_us
        Length of the interval, and as in `Interval`.
    slots
        Events of a pixel to compute; those that it does not fire are meaningless.
    work
        Memory; `slots` receives the packed events.
    """
    level_0, move, whole = work.curve[LEVEL_0], work.curve[MOVE], work.curve[WHOLE_RISE]
    level, scale, words = work.curve[LEVEL_NOW], work.curve[SCALE], work.words
    for k in range(u0.size):
        level[k] = level_0[k]
        scale[k] = dt_us / whole[k]
    for slot in range(slots):
        out = work.slots[slot]
        for k in range(u0.size):
            level[k] += move[k]
            out[k] = pack((level[k] - u0[k]) * scale[k], start_us, length_us, words[k])


@jit
def write_lines(u0, dt_us, start_us, length_us, few, work, used):
    """Append the events of all flagged ideal pixels to the pool.

    All slots of a pixel are written, and the next pixel overwrites those without an event, because
    a branch on the number of events would be mispredicted. Few pixels have more events than slots.

    Parameters
    ----------
    u0, dt_us, start_us, length_us, work
        As in `time_lines`.
    few
        Use only FEW_SLOTS.
    used
        Used size of the pool.

    Returns
    -------
    int
        New used size of the pool.
    """
    slots = FEW_SLOTS if few else SLOTS
    time_lines(u0, dt_us, start_us, length_us, slots, work)
    first, second, third, fourth = work.slots
    fired, pool = work.fired, work.pool
    level_0, move, scale = work.curve[LEVEL_0], work.curve[MOVE], work.curve[SCALE]
    out = np.uint64(used)  # unsigned: Numba checks if signed indices are negative
    for k in range(u0.size):
        n = fired[k]
        pool[out] = first[k]
        pool[out + np.uint64(1)] = second[k]
        if not few:
            pool[out + np.uint64(2)] = third[k]
            pool[out + np.uint64(3)] = fourth[k]
        if n > slots:
            level = level_0[k]
            for event in range(n):
                level += move[k]
                pool[out + np.uint64(event)] = pack(
                    (level - u0[k]) * scale[k], start_us, length_us, work.words[k]
                )
        out += np.uint64(n)
    return np.int64(out)


@jit
def events_of_lines(flagged, lines, comparators, light_band, alike, work, used):
    """Fire the flagged ideal pixels over one interval, for all settings with equal crossings.

    Parameters
    ----------
    flagged
        Indices of the pixels.
    lines, comparators, light_band
        Log intensity; memory and thresholds; the bounds on the light. The last two are updated.
    alike, work, used
        Settings, memory, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    u0, u1, _, leaked = lines
    memory = comparators.memory
    darkest, brightest = light_band.darkest, light_band.brightest
    total = count_lines(flagged, lines, comparators, work)
    few = total < FEW_SLOTS * flagged.size
    for m in range(alike.setting, alike.leader.size):
        if alike.leader[m] != alike.setting:
            continue
        if used + total + SLOTS > work.pool.size:
            return FULL
        alike.segment[m, START] = used
        dt_us, start_us, length_us = alike.dt_s[m] * 1e6, alike.start_us[m], alike.length_us[m]
        used = write_lines(u0, dt_us, start_us, length_us, few, work, used)
        alike.segment[m, STOP] = used
    level, fall, rise = work.curve[LEVEL_END], work.curve[FALL], work.curve[RISE_TO]
    if comparators.alike:
        for k in range(flagged.size):
            fall[k], rise[k] = light_band.fall[0], light_band.rise[0]
    else:
        for k in range(flagged.size):
            fall[k], rise[k] = light_band.fall[flagged[k]], light_band.rise[flagged[k]]
    for k in range(u0.size):
        u0[k], u1[k] = light_bounds(level[k], leaked, fall[k], rise[k])
    for k in range(flagged.size):
        i = flagged[k]
        memory[i], darkest[i], brightest[i] = level[k], u0[k], u1[k]
    return used


# Rows of `Work.curve`, one column for each flagged filtered pixel. An interval has up to four
# pieces, which end at the turning points of v2 (or 0 and SHAPED without), at the end of its
# transient, and at WHOLE = a dt; four rows with v2 at these ends follow. FLAT is the turning point
# of the slope of v2, at most SHAPED; BENT says that there is more than one piece.
U_START, U_END, V1_START, V1_STOP, V2_START = range(5)
CURVE_START_V, CURVE_RISE, CURVE_A, CURVE_B, CURVE_SHORT = range(5, 10)
CUT_0, CUT_1, SHAPED, WHOLE, V_CUT_0, V_CUT_1, V_SHAPED, V2_STOP = range(10, 18)
SLOPE_START, SLOPE_STOP, FLAT, TURNS_BEFORE, TURNS_AFTER, BENT = range(18, 24)
CURVE_SIZE = 24
PIECES = 4


@jit
def describe_curves(curve, count, poles, drift):
    """Compute the curve of v2 of each flagged pixel from its state, in a vectorized loop.

    Parameters
    ----------
    curve
        (CURVE_SIZE, block), updated.
    count
        Number of flagged pixels.
    poles, drift
        1 or 2, and fall of the memory over the interval.
    """
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
        start = v2[k] if short > 0.0 else u0[k] - poles * S
        at_flat = v2_and_slopes_at(flat, Curve(start, rise, A, B, short))[1]
        slope_flat = at_flat if inside else slope_end
        turns_before, turns_after = slope_start * slope_flat < 0.0, slope_flat * slope_end < 0.0
        curve[V2_STOP, k] += drift
        curve[CURVE_START_V, k] = start
        curve[CURVE_RISE, k] = rise
        curve[CURVE_A, k] = A
        curve[CURVE_B, k] = B
        curve[SLOPE_START, k] = slope_start
        curve[SLOPE_STOP, k] = slope_end
        curve[FLAT, k] = flat
        curve[TURNS_BEFORE, k] = 1.0 if turns_before else 0.0
        curve[TURNS_AFTER, k] = 1.0 if turns_after else 0.0
    start_v, rise_v, turns = curve[CURVE_START_V], curve[CURVE_RISE], curve[TURNS_BEFORE]
    turns_late = curve[TURNS_AFTER]
    for k in range(count):  # more rows in one loop would not be vectorized
        shaped = min(whole[k], TRANSIENT)
        straight = shaped == whole[k]
        v_shaped = v2_end[k] if straight else start_v[k] + shaped * rise_v[k]
        curve[CURVE_SHORT, k] = 1.0 if whole[k] < SHORT_X else 0.0
        curve[CUT_0, k] = 0.0
        curve[CUT_1, k] = curve[SHAPED, k] = shaped
        curve[V_CUT_1, k] = curve[V_SHAPED, k] = v_shaped
        curve[BENT, k] = turns[k] + turns_late[k] + (0.0 if straight else 1.0)


@jit
def find_turns(count, work):
    """Compute the turning points of v2 of each flagged pixel, and v2 there.

    The slope of v2 has at most one turning point, FLAT; it is monotone on both sides.

    Parameters
    ----------
    count
        Number of flagged pixels.
    work
        Memory with the rows of `describe_curves`.
    """
    curve, todo, todo_of = work.curve, work.todo, work.todo_of
    before, after = curve[TURNS_BEFORE], curve[TURNS_AFTER]
    listed = np.uint64(0)  # unsigned: Numba checks if signed indices are negative
    for k in range(np.uint64(count)):
        # Without a branch: the next pixel overwrites what this one does not need.
        todo_of[listed] = k << np.uint64(1)
        listed += np.uint64(before[k])
        todo_of[listed] = k << np.uint64(1) | np.uint64(1)
        listed += np.uint64(after[k])
        if listed > np.uint64(CROSSING_BATCH - 3) or k == np.uint64(count - 1):
            for j in range(listed):
                of, second = todo_of[j] >> np.uint64(1), todo_of[j] & np.uint64(1)
                flat = curve[FLAT, of]
                todo[LOW, j] = flat if second else 0.0
                todo[HIGH, j] = curve[SHAPED, of] if second else flat
                copy_curve(curve, of, todo, j)
            solve_turns(todo, np.int64(listed))
            for j in range(listed):
                of, second = todo_of[j] >> np.uint64(1), todo_of[j] & np.uint64(1)
                curve[np.uint64(CUT_0) + second, of] = todo[ROOT, j]
                curve[np.uint64(V_CUT_0) + second, of] = todo[V_ROOT, j]
            listed = np.uint64(0)


@inlined
def copy_curve(curve, of, todo, j):
    """Copy the curve of a flagged pixel to a turning point or crossing to solve.

    Parameters
    ----------
    curve, of, todo, j
        Source and its column, target and its column.
    """
    todo[START_V, j], todo[RISE, j] = curve[CURVE_START_V, of], curve[CURVE_RISE, of]
    todo[POLE_A, j], todo[POLE_B, j] = curve[CURVE_A, of], curve[CURVE_B, of]
    todo[SHORT, j] = curve[CURVE_SHORT, of]


@jit
def fire(count, interval, work, used):
    """Solve the listed crossings and append them to the pool as events.

    Parameters
    ----------
    count
        Number of listed crossings.
    interval, work, used
        Clock, crossings in `todo` without their curves, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    curve, todo, pool = work.curve, work.todo, work.pool
    if used + count > pool.size:
        return FULL
    us, slack, root = todo[US], todo[SLACK], todo[ROOT]
    for j in range(count):
        of = work.todo_of[j]
        copy_curve(curve, of, todo, j)
        us[j] = curve[WHOLE, of]
    dt_us = interval.dt_s * 1e6
    for j in range(count):
        us[j] = dt_us / us[j]
        slack[j] = min(1.0, 1e6 / us[j]) * 1e-9  # of the time constant 1/a, and of a second
    solve_crossings(todo, count)
    start_us, length_us = interval.start_us, interval.length_us
    for j in range(count):
        pool[used + j] = pack(root[j] * us[j], start_us, length_us, work.todo_words[j])
    return used + count


@jit
def events_of_curves(flagged, response, interval, comparators, work, used):
    """Fire the flagged filtered pixels over one interval.

    The interval is split at the turning points of v2, at most two, and at the end of its transient.
    The levels that each monotone piece crosses are listed, and `fire` computes the times.

    Parameters
    ----------
    flagged
        Indices of the pixels.
    response, interval
        v1, v2 and u at both ends, and the clock.
    comparators
        Memory and thresholds; the memory is updated.
    work, used
        Memory with the row WHOLE of `curve` filled in, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    u0, u1, v1, v2, v1_end, v2_end, poles = response
    memory, C_on, C_off, _ = comparators
    curve, todo = work.curve, work.todo
    for k in range(flagged.size):
        i = flagged[k]
        curve[U_START, k], curve[U_END, k] = u0[i], u1[i]
        curve[V1_START, k], curve[V1_STOP, k] = v1[i], v1_end[i]
        curve[V2_START, k], curve[V2_STOP, k] = v2[i], v2_end[i]
    describe_curves(curve, flagged.size, poles, interval.drift)
    find_turns(flagged.size, work)
    count = np.uint64(0)  # unsigned: Numba checks if signed indices are negative
    for k in range(np.uint64(flagged.size)):
        i = flagged[k]
        level, on, off = memory[i], C_on[i], C_off[i]
        low, v_low, slope_low = 0.0, curve[V2_START, k], curve[SLOPE_START, k]
        pieces = PIECES if curve[BENT, k] > 0.0 else 1
        for piece in range(np.uint64(PIECES - pieces), np.uint64(PIECES)):
            high = curve[np.uint64(CUT_0) + piece, k]
            if high <= low:
                continue
            v_high = curve[np.uint64(V_CUT_0) + piece, k]
            slope_high = 0.0 if high < curve[SHAPED, k] else curve[SLOPE_STOP, k]
            up = v_high > level
            C = on if up else off
            move = C if up else -C
            word = work.position[i] | (np.uint64(up) << POLARITY_SHIFT)
            while abs(v_high - level) >= C:
                if count == np.uint64(CROSSING_BATCH):
                    used = fire(np.int64(CROSSING_BATCH), interval, work, used)
                    count = np.uint64(0)
                    if used < 0:
                        return FULL
                level += move
                todo[LEVEL, count] = level
                todo[LOW, count], todo[HIGH, count] = low, high
                todo[V_LOW, count], todo[V_HIGH, count] = v_low, v_high
                todo[SLOPE_LOW, count], todo[SLOPE_HIGH, count] = slope_low, slope_high
                work.todo_of[count], work.todo_words[count] = k, word
                count += np.uint64(1)
            low, v_low, slope_low = high, v_high, slope_high
        memory[i] = level
    return fire(np.int64(count), interval, work, used)


@allocating
def outside_refractory(events, refractory_us, ready_us):
    """Mark the events that come at least the refractory period after the pixel's last marked one.

    Parameters
    ----------
    events
        `Columns` of N events in order.
    refractory_us
        Refractory period.
    ready_us
        (height, width) int64, the time at which each pixel can fire again; updated.

    Returns
    -------
    (N,) bool
    """
    t_us, x, y, _ = events
    keep = np.empty(t_us.size, np.bool_)
    latest = np.iinfo(np.int64).max - refractory_us
    for k in range(t_us.size):
        keep[k] = t_us[k] >= ready_us[y[k], x[k]]
        if keep[k]:
            ready_us[y[k], x[k]] = min(t_us[k], latest) + refractory_us
    return keep
