"""A band of pixels through a chunk of frame intervals: the kernels one after the other.

Kernels walk over blocks of pixels and take each block through several frame intervals of every
setting before going on, so that a block's state stays in the second-level cache.
"""

from __future__ import annotations

import math

import numpy as np

from sensor.kernels.comparator import CURVE_SIZE, events_of_curves, events_of_lines
from sensor.kernels.crossings import CROSSING_BATCH, CROSSING_SIZE
from sensor.kernels.elementary import exp, jit
from sensor.kernels.noise import noise_events
from sensor.kernels.packing import ROW_SHIFT, START, STOP
from sensor.kernels.photoreceptor import (
    DT_S,
    LEAK_PER_S,
    LIGHT_A,
    POLES,
    E,
    X,
    poles_to_end,
    poles_to_end_in_own_light,
)
from sensor.kernels.radiance import log_intensity, log_of_flagged
from sensor.kernels.silence import band_of_light, flag_filtered, flag_ideal, list_flagged

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
