"""Advance a band of pixels through a chunk of frame intervals; calls the other kernels in order.

The outer loop is over blocks of pixels. Each block goes through all frame intervals and settings of
the chunk before the next one, so that its state stays in the caches.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor.kernels.comparator import (
    CURVE_SIZE,
    SLOTS,
    WHOLE,
    Alike,
    Lines,
    Work,
    events_of_curves,
    events_of_lines,
)
from sensor.kernels.crossings import CROSSING_BATCH, CROSSING_SIZE
from sensor.kernels.elementary import exp, inlined, jit
from sensor.kernels.noise import NoiseSource, noise_events
from sensor.kernels.packing import START, STOP, Interval, place
from sensor.kernels.photoreceptor import Response, poles_to_end_in_own_light
from sensor.kernels.radiance import BAD, log_of_block, log_of_flagged
from sensor.kernels.silence import (
    CHORD_STEP,
    CUBIC_STEP,
    Comparators,
    LightBand,
    flag_by_all,
    flag_by_chord,
    flag_by_cubic,
    flag_ideal,
    flag_in_own_light,
    list_flagged,
    set_light_band,
)
from sensor.memory import MEMORY

DONE = 0  # outcome of `advance_pixels`; the others are FULL and BAD


class Band(NamedTuple):
    """The range of pixels of one call, in raster order."""

    width: int  # of the sensor
    start: int
    stop: int
    block_px: int


class State(NamedTuple):
    """State of all pixels at a frame time; updated from the first to the last of the chunk."""

    u: NDArray[np.float64]  # (height * width,) log intensity
    v1: NDArray[np.float64]  # (S, height * width), or (S, 0) without a filter
    v2: NDArray[np.float64]
    memory: NDArray[np.float64]  # (S, height * width)


class Settings(NamedTuple):
    """The electronics of S settings; arrays are (S,) unless noted."""

    C_on: NDArray[np.float64]  # (S, height * width) contrast thresholds, or (S, 1) if uniform
    C_off: NDArray[np.float64]
    hot_hz: NDArray[np.float64]  # (S, height * width) rate of hot pixels, or (S, 0) without
    poles: NDArray[np.float64]  # 1 or 2
    light_a: NDArray[np.float64]  # a / (I + I_dark + light_0), or 0 if a does not depend on I
    light_0: NDArray[np.float64]
    leak_per_s: NDArray[np.float64]  # fall of the memory, log units per second
    noise_hz: NDArray[np.float64]  # rate of shot noise in the dark
    noise_exponent: NDArray[np.float64]
    filtered: NDArray[np.bool_]  # cutoff_hz is finite
    noisy: NDArray[np.bool_]  # shot noise or hot pixels
    leader: NDArray[np.int64]  # first setting with the same events except for the times, or itself
    seed: np.uint64


class Clock(NamedTuple):
    """The F frame intervals of a chunk on the clock of each setting."""

    first_frame: int  # index of the first interval since the first frame, for random numbers
    steps: NDArray[np.void]  # (S, F) of dtype STEP
    dt_s: NDArray[np.float64]  # (S, F), this and the rest as in `Interval`
    start_us: NDArray[np.float64]
    length_us: NDArray[np.int64]


class Resume(NamedTuple):
    """The place at which `advance_pixels` stopped."""

    block: int
    setting: int
    used: int  # used size of the pool


class Block(NamedTuple):
    """State of one block and setting, and scratch memory."""

    u: NDArray[np.float64]  # (F + 1, block) log intensity at all frames of the chunk
    v1: NDArray[np.float64]  # (2, block) at the start and the end of an interval, in turn
    v2: NDArray[np.float64]
    x: NDArray[np.float64]  # (block,) a dt of each pixel, if its cutoff depends on the light
    e: NDArray[np.float64]  # (block,) exp(-a dt)
    lines: NDArray[np.float64]  # (2, block) u0 and u1 of the flagged ideal pixels
    light: NDArray[np.float64]  # (block,) radiance of the flagged pixels
    flag: NDArray[np.bool_]  # padded to whole 8-byte words
    flagged: NDArray[np.uint64]  # indices of the flagged pixels
    comparators: Comparators
    light_band: LightBand
    work: Work


def room_for_block(intervals: int, size: int, alike: bool, pool: NDArray[np.uint64]) -> Block:
    """Allocate a block.

    Parameters
    ----------
    intervals
        F, frame intervals of the chunk.
    size
        Pixels of the block.
    alike
        Whether all pixels of a setting have the same thresholds.
    pool
        (capacity,) memory for packed events.

    Returns
    -------
    Block
    """
    words = (size + 15) // 8 * 8
    return Block(
        MEMORY.array((intervals + 1, size)),
        MEMORY.array((2, size)),
        MEMORY.array((2, size)),
        MEMORY.array(size),
        MEMORY.array(size),
        MEMORY.array((2, size)),
        MEMORY.array(size),
        MEMORY.array(words, np.bool_),
        MEMORY.array(words + 8, np.uint64),
        Comparators(MEMORY.array(size), MEMORY.array(size), MEMORY.array(size), alike),
        LightBand(
            MEMORY.array(size, np.float32),
            MEMORY.array(size, np.float32),
            MEMORY.array(size),
            MEMORY.array(size),
        ),
        Work(
            MEMORY.array(size, np.uint64),
            MEMORY.array((CURVE_SIZE, size)),
            MEMORY.array((CROSSING_SIZE, CROSSING_BATCH)),
            MEMORY.array(CROSSING_BATCH, np.uint64),
            MEMORY.array(CROSSING_BATCH, np.uint64),
            MEMORY.array(size, np.uint64),
            MEMORY.array(size, np.int64),
            MEMORY.array((SLOTS, size), np.uint64),
            pool,
        ),
    )


@jit
def copy(source, out):
    """Copy an array. Numba's slice assignment also checks for overlap, which compiles slowly.

    Parameters
    ----------
    source, out
        (n,) input and output.
    """
    for i in range(out.size):
        out[i] = source[i]


@inlined
def load(s, pixels, state, settings, block):
    """Copy state and thresholds of one setting into the block.

    Parameters
    ----------
    s, pixels
        Setting, and slice of the pixels.
    state, settings, block
        Input, input and output.
    """
    memory, C_on, C_off, alike = block.comparators
    n = pixels.stop - pixels.start
    if alike:
        for i in range(n):
            C_on[i], C_off[i] = settings.C_on[s, 0], settings.C_off[s, 0]
    else:
        copy(settings.C_on[s, pixels], C_on[:n])
        copy(settings.C_off[s, pixels], C_off[:n])
    copy(state.memory[s, pixels], memory[:n])
    if settings.filtered[s]:
        copy(state.v1[s, pixels], block.v1[0, :n])
        copy(state.v2[s, pixels], block.v2[0, :n])
    else:
        set_light_band(n, block.comparators, block.light_band)


@inlined
def ideal_interval(f, pixels, light, interval, leaked, alike, block, used):
    """Fire the ideal pixels of a block over one interval.

    Parameters
    ----------
    f, pixels
        Interval of the chunk, and slice of the pixels.
    light, interval
        Radiance, and the clock of the leading setting.
    leaked
        Fall of the memory since `set_light_band`.
    alike, block, used
        Settings with equal events except for the times, state, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, FULL or BAD.
    """
    fade = exp(-leaked - interval.drift)
    flag_ideal(light, f, pixels, fade, block.light_band, block.flag)
    n = pixels.stop - pixels.start
    flagged = block.flagged[: list_flagged(block.flag, n, block.flagged)]
    u0, u1 = block.lines[0, : flagged.size], block.lines[1, : flagged.size]
    if f == 0:
        for k in range(flagged.size):
            u0[k] = block.u[0, flagged[k]]
    else:
        log_of_flagged(flagged, light, f - 1, pixels, block.light, u0)
    if not log_of_flagged(flagged, light, f, pixels, block.light, u1):
        return BAD
    lines = Lines(u0, u1, interval.drift, leaked)
    return events_of_lines(
        flagged, lines, block.comparators, block.light_band, alike, block.work, used
    )


@inlined
def filtered_interval(s, f, n, settings, step, interval, block, used):
    """Fire the filtered pixels of a block over one interval.

    Parameters
    ----------
    s, f, n
        Setting, interval of the chunk, and number of pixels.
    settings, step, interval
        Electronics, coefficients of the poles, and clock.
    block, used
        State, and used size of the pool.

    Returns
    -------
    int
        New used size of the pool, or FULL.
    """
    now, end = f & 1, (f & 1) ^ 1
    ends = block.u[f], block.u[f + 1], block.v1[now], block.v2[now], block.v1[end], block.v2[end]
    response = Response(*ends, settings.poles[s])
    light_a = settings.light_a[s]
    if light_a > 0.0:
        light_0 = settings.light_0[s]
        poles_to_end_in_own_light(n, response, light_a, light_0, interval.dt_s, block.x, block.e)
        flag_in_own_light(
            n, response, block.x, block.e, interval.drift, block.comparators, block.flag
        )
        flagged = block.flagged[: list_flagged(block.flag, n, block.flagged)]
        for k in range(flagged.size):
            block.work.curve[WHOLE, k] = block.x[flagged[k]]
    else:
        if step.x < CHORD_STEP:
            flag_by_chord(n, response, step, interval.drift, block.comparators, block.flag)
        elif step.x < CUBIC_STEP:
            flag_by_cubic(n, response, step, interval.drift, block.comparators, block.flag)
        else:
            flag_by_all(n, response, step, interval.drift, block.comparators, block.flag)
        flagged = block.flagged[: list_flagged(block.flag, n, block.flagged)]
        for k in range(flagged.size):
            block.work.curve[WHOLE, k] = step.x
    return events_of_curves(flagged, response, interval, block.comparators, block.work, used)


@jit
def advance_pixels(light, band, state, settings, clock, block, resume, segment):
    """Advance a band of pixels through F frame intervals of S settings.

    Parameters
    ----------
    light, band
        Radiance of the chunk, and range of pixels.
    state, settings, clock
        Of all pixels and settings; the state is updated.
    block
        Memory, with the pool that receives the events.
    resume
        Place to start at; `Resume(0, 0, 0)` in the first call.
    segment
        (blocks, S, F, 2) int64 output: START and STOP in the pool.

    Returns
    -------
    outcome, resume
        DONE; FULL if the pool is too small: repeat the call with `resume` and a larger pool; or BAD
        if radiance is negative or not finite.
    """
    F = clock.dt_s.shape[1]
    memory = block.comparators.memory
    # Ideal pixels without events need no logarithm before the last frame of the chunk.
    first_u = 0 if settings.filtered.any() or settings.noisy.any() else F - 1
    used = resume.used
    for b in range(resume.block, segment.shape[0]):
        start = band.start + b * band.block_px
        stop = min(start + band.block_px, band.stop)
        n, pixels = stop - start, slice(start, stop)
        place(start, band.width, block.work.position[:n])
        for i in range(n, block.flag.size):
            block.flag[i] = False
        copy(state.u[pixels], block.u[0, :n])
        for f in range(first_u, F):
            if not log_of_block(light, f, pixels, block.u[f + 1, :n]):
                return BAD, Resume(b, 0, 0)
        for s in range(resume.setting if b == resume.block else 0, settings.leader.size):
            if settings.leader[s] != s:
                continue
            used_before = used
            leaked = 0.0  # fall of the memory since `set_light_band`
            load(s, pixels, state, settings, block)
            for f in range(F):
                drift = settings.leak_per_s[s] * clock.dt_s[s, f]
                interval = Interval(
                    clock.dt_s[s, f], drift, clock.start_us[s, f], clock.length_us[s, f]
                )
                begin = used
                if settings.filtered[s]:
                    step = clock.steps[s, f]
                    used = filtered_interval(s, f, n, settings, step, interval, block, used)
                    segment[b, s, f, START] = begin
                else:
                    alike = Alike(
                        s,
                        settings.leader,
                        clock.dt_s[:, f],
                        clock.start_us[:, f],
                        clock.length_us[:, f],
                        segment[b, :, f],
                    )
                    used = ideal_interval(f, pixels, light, interval, leaked, alike, block, used)
                if drift != 0.0:
                    for i in range(n):
                        memory[i] -= drift
                    leaked += drift
                if settings.noisy[s] and used >= 0:
                    source = NoiseSource(
                        settings.noise_hz[s],
                        settings.noise_exponent[s],
                        light.dark,
                        settings.hot_hz[s, pixels],
                        settings.seed,
                        start,
                    )
                    used = noise_events(
                        source,
                        block.u[f, :n],
                        block.u[f + 1, :n],
                        clock.first_frame + f,
                        interval,
                        block.work,
                        begin,
                        used,
                    )
                if used < 0:
                    return used, Resume(b, s, used_before)
                if settings.filtered[s] or settings.noisy[s]:
                    segment[b, s, f, STOP] = used
            copy(memory[:n], state.memory[s, pixels])
            if settings.filtered[s]:
                copy(block.v1[F & 1, :n], state.v1[s, pixels])
                copy(block.v2[F & 1, :n], state.v2[s, pixels])
        copy(block.u[F, :n], state.u[pixels])
    return DONE, Resume(segment.shape[0], 0, used)
