"""What the threads of a GPU do, as a loop on the CPU: it counts the events, then writes them."""

import math

import numpy as np

from sensor import SensorModel
from sensor.engine.frames import whole_microseconds
from sensor.engine.group import SensorGroup
from sensor.kernels.elementary import jit, log
from sensor.kernels.noise import NoiseSource
from sensor.kernels.packing import COORDINATE_MASK, POLARITY_SHIFT, TIME_SHIFT
from sensor.kernels.photoreceptor import Step, photoreceptor_step
from sensor.kernels.pixel import (
    Comparator,
    Filter,
    Out,
    Span,
    advance_filtered,
    fire_line,
    fire_noise,
)


@jit
def advance(light, dark, state, thresholds, hot_hz, clock, which, noise, counts, starts, words):
    """Advance all pixels of a row; write their events if `words` is not empty.

    Parameters
    ----------
    light, dark
        (F, P) radiance, and I_dark.
    state, thresholds
        (4, P) u, v1, v2 and memory; (2, P) C_on and C_off.
    hot_hz
        (P,) or (0,).
    clock
        (F, 12), `Span` and `Step`.
    which, noise
        `Filter`, and (rate, exponent, logarithm of I_dark, seed).
    counts, starts, words
        (F, P), the output of the count; (F, P), the place of each pixel's first event; (N,) output.
    """
    writes = words.size > 0
    for i in range(light.shape[1]):
        u0, a, b, level = state[0, i], state[1, i], state[2, i], state[3, i]
        for f in range(light.shape[0]):
            u1 = log(light[f, i] + dark)
            row = clock[f]
            span = Span(row[0], row[1], row[2], np.int64(row[3]), np.int64(row[4]))
            step = Step(row[5], row[6], row[7], row[8], row[9], row[10], row[11])
            out = Out(i, words, starts[f, i], writes)
            comparator = Comparator(level, thresholds[0, i], thresholds[1, i])
            fires = counts[f, i] > 0 or not writes
            if which.poles > 0.0:
                a, b, level, count = advance_filtered(
                    u0, u1, a, b, which, step, fires, comparator, span, out
                )
            else:
                level, count = fire_line(u0, u1, comparator, span, out)
            source = NoiseSource(noise[0], noise[1], dark, hot_hz, noise[3], 0)
            if fires:
                count = fire_noise(source, noise[2], u0, u1, i, f, span, out, count)
            if not writes:
                counts[f, i] = count
            level -= row[1]
            u0 = u1


def events_of_row(
    radiance: np.ndarray, t_s: np.ndarray, model: SensorModel, seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times in us, columns and polarities of a sensor of one row of pixels, by time.

    Parameters
    ----------
    radiance, t_s, model, seed
        (T, P) light, its times, and a model of P x 1 px that knows its dark level.
    """
    pixels = radiance.shape[1]
    start = SensorGroup.start([0], [model], [1.0], radiance[:1], seed, 0)
    settings = start.settings
    u, (v1,), (v2,), (memory,) = start.state
    state = np.stack((u, v1, v2, memory) if v1.size else (u, u, u, memory))
    thresholds = np.stack([np.resize(C[0], pixels) for C in (settings.C_on, settings.C_off)])
    frame_us, after_us = whole_microseconds(t_s)
    dt_s = np.diff(t_s)
    since_us = frame_us[:-1] - frame_us[0]
    spans = dt_s, settings.leak_per_s[0] * dt_s, after_us[:-1], np.diff(frame_us), since_us
    steps = [photoreceptor_step(each, model.cutoff_hz, model.poles) for each in dt_s]
    clock = np.column_stack((*spans, np.array(steps)))
    poles = float(settings.poles[0]) if settings.filtered[0] else 0.0
    which = Filter(poles, float(settings.light_a[0]), float(settings.light_0[0]))
    log_dark = math.log(model.dark_level) if model.dark_level else 0.0
    noise = model.shot_noise_hz, model.shot_noise_exponent, log_dark, settings.seed
    counts = np.zeros((len(dt_s), pixels), np.int64)
    starts, words = np.zeros_like(counts), np.empty(0, np.uint64)
    light = radiance[1:].astype(np.float64)
    dark = float(model.dark_level or 0.0)
    fixed = light, dark, state, thresholds, settings.hot_hz[0], clock, which, noise
    advance(*fixed, counts, starts, words)
    ends = np.cumsum(counts).reshape(counts.shape)
    words = np.zeros(int(counts.sum()), np.uint64)
    if words.size:
        advance(*fixed, counts, ends - counts, words)
    words = words[np.argsort(words >> TIME_SHIFT, kind="stable")]
    up = ((words >> POLARITY_SHIFT) & np.uint64(1)).astype(np.int8)
    t_us = frame_us[0] + (words >> TIME_SHIFT).astype(np.int64)
    return t_us, (words & COORDINATE_MASK).astype(np.int64), 2 * up - 1
