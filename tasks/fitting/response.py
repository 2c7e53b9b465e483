"""Cutoff and latency, from light that steps up at known times."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import optimize

from eres_render.errors import reading
from sensor import Events
from sensor.errors import EventError
from sensor.formats import read_triggers
from sensor.model import Photoreceptor
from tasks.errors import TaskError
from tasks.numerics.estimate import Estimate, units
from tasks.recording.levels import Float64, Int64

_MIN_STEPS = 2
_MIN_EVENTS = 3.0  # mean number of events of a pixel after a step
_LATE = 0.25  # of the early events of a pixel that sees the lamp, at most
_POINTS = 120  # of the curve
_MIN_POINTS = 5  # one more than parameters
_FROM = 1.0  # events of a pixel, as the first one depends on its memory
_DRAWS = 100
_TAIL = 0.995
# B for one pole: (1 + C_off / C_on) / 2 for a pixel whose light fell before, and its range for
# C_off / C_on from 1/2 to 3/2. For two poles, B is fitted.
_ABSORBED = 1.0
_ABSORBED_RANGE = (0.75, 1.25)
_LATER = 2.0  # times as late as the first event of other steps: the recording began after the step
_WHOLE = 0.98  # of the events of other steps, at least, unless the recording ended before


class Response(NamedTuple):
    """Response of the photoreceptor to a step of the light.

    Parameters
    ----------
    photoreceptor
        "two_pole" or "one_pole", whichever fits better.
    cutoff_hz, latency_s
        Corner frequency, and the delay that the poles do not explain.
    first_event_s
        (3,) delays of the first event of a pixel after a step, seconds: the 5th, 50th and 95th
        percentiles.
    steps
        Number of steps whose answers are in the recording.
    """

    photoreceptor: Photoreceptor
    cutoff_hz: Estimate
    latency_s: Estimate
    first_event_s: tuple[float, float, float]
    steps: int


def read_steps(where: str, recording: str | Path, format: str | None = None) -> Int64:
    """Read the times at which the light steps up.

    Parameters
    ----------
    where
        A text file with one time per line, microseconds; or "triggers", for the rising edges in the
        recording, with the number of their channel as in "triggers:1" if it has several.
    recording, format
        The recording, and its format; by default that of its extension or header.

    Returns
    -------
    (S,) microseconds, on the clock of the events.

    Raises
    ------
    TaskError
        A line of the file is no time, or the recording has edges on other channels.
    """
    if chosen := re.fullmatch(r"triggers(?::(\d+))?", where):
        channel = None if chosen[1] is None else int(chosen[1])
        triggers = read_triggers(recording, format=format)
        try:
            return triggers.rising_us(channel)
        except EventError as error:
            raise TaskError(f"{recording}: {error}, as in --steps triggers:1") from None
    file = Path(where)
    with reading(file, "text", TaskError):
        lines = file.read_text(encoding="utf-8").splitlines()
    times = []
    for k, line in enumerate(lines, start=1):
        if text := line.partition("#")[0].strip():
            try:
                times.append(np.int64(round(float(text))))
            except (ValueError, OverflowError):
                raise TaskError(f"{file}:{k}: found {text!r}, expected a time in us") from None
    return np.array(times, np.int64)


def fit_response(events: Events, rises_us: Int64) -> Response:
    """Estimate cutoff and latency from the ON events after steps of the light.

    Only pixels that see the lamp are used: those with at least one ON event per step on average in
    the first half of the time between steps, and at most a quarter as many in the second; other
    pixels fire at any time. The mean number of ON events of a pixel until a time t after the step
    is A g(a (t - latency)) - B, where g is the step response of one pole, 1 - e^{-y}, or of two, 1
    - (1 + y) e^{-y}; A is the step in thresholds, and B the part of it that the memories of the
    pixels absorb. Least squares finds A, B, a and the latency, from the first event of the mean
    pixel on. With one pole, a delay looks like another B, so B is fixed: at 1, for equal
    thresholds, and at 3/4 and 5/4 for the interval. One and two poles are compared with B at 1. The
    interval is a bootstrap over tiles of pixels, or over pixels if the lamp is in fewer than eight
    tiles. It is widened by the change of the estimate if the fit begins half an event later, and by
    its change with another B.

    Parameters
    ----------
    events
        The events. Each belongs to the step before it, for the shortest time between steps.
    rises_us
        (S,) times of the steps, on the clock of the events, increasing.

    Returns
    -------
    Response

    Raises
    ------
    TaskError
        There are fewer than two steps whose answers are in the recording, too few events after
        them, or too few different times.
    """
    answers = _answers(events, rises_us)
    order, cutoff, latency = _estimates(answers)
    first = np.full(len(answers.tile) * answers.steps, np.inf)
    trial = answers.place * answers.steps + answers.step
    np.minimum.at(first, trial, answers.since_us * 1e-6)
    first_s = np.quantile(first[np.isfinite(first)], (0.05, 0.5, 0.95)).tolist()
    photoreceptor: Photoreceptor = "two_pole" if order == 2 else "one_pole"
    return Response(photoreceptor, cutoff, latency, tuple(first_s), answers.steps)


class _Answers(NamedTuple):
    """ON events of the pixels that see the lamp."""

    since_us: Int64  # (N,) time since the step
    step: Int64  # (N,) number of the step
    place: Int64  # (N,) number of the pixel
    tile: Int64  # (P,) number of the tile of each pixel, or of the pixel
    steps: int


def _answers(events: Events, rises_us: Int64) -> _Answers:
    if len(rises_us) < _MIN_STEPS or np.any(np.diff(rises_us) <= 0):
        times = f"--steps: found {len(rises_us)} step times"
        raise TaskError(f"{times}, expected at least {_MIN_STEPS}, in increasing order")
    window_us = int(np.diff(rises_us).min())
    rises_us = _whole_steps(events, rises_us, window_us)
    answers, step, since_us = _after_steps(events, rises_us, window_us)
    pixel = answers.y.astype(np.int64) * events.width + answers.x
    # A pixel that sees the lamp has fallen silent half-way to the next step.
    is_early, size = since_us < window_us / 2, int(pixel.max(initial=0)) + 1
    early, late = (np.bincount(pixel[half], minlength=size) for half in (is_early, ~is_early))
    lit = ((early >= len(rises_us)) & (late <= _LATE * early))[pixel]
    if len(lit) and not lit.any():
        raise TaskError(
            "--steps: no pixel fires after a step and falls silent before the next; the steps of "
            "the light are too small, too close together, or at other times"
        )
    since_us, pixel, step = since_us[lit], pixel[lit], step[lit]
    answering, place = np.unique(pixel, return_inverse=True)
    trials = len(answering) * len(rises_us)
    if len(since_us) < _MIN_EVENTS * max(trials, 1):
        mean = f"{len(since_us) / max(trials, 1):.2g} ON events per pixel and step"
        least = f"expected at least {_MIN_EVENTS:g}; larger steps help"
        raise TaskError(f"--steps: found {mean}, {least}")
    return _Answers(since_us, step, place, units(answering, events.width), len(rises_us))


def _after_steps(events: Events, rises_us: Int64, window_us: int) -> tuple[Events, Int64, Int64]:
    """Return the events that answer a step, the number of the step, and the time since then."""
    step = np.searchsorted(rises_us, events.t_us, side="right") - 1
    since_us = events.t_us - rises_us[np.maximum(step, 0)]
    answers = (step >= 0) & (since_us < window_us) & (events.p > 0)
    return events.where(answers), step[answers], since_us[answers]


def _whole_steps(events: Events, rises_us: Int64, window_us: int) -> Int64:
    """Return the steps whose answers the recording has, and not only the first part of them."""
    if not len(events):
        return rises_us
    first_us, last_us = events.t_us[[0, -1]].tolist()
    inside = rises_us[(rises_us > first_us - window_us) & (rises_us < last_us)]
    if len(inside) > 1:
        # Pixels may be silent between steps: then the first and the last event do not tell when the
        # recording began and ended, but how these steps differ from the others does.
        _, step, since_us = _after_steps(events, inside, window_us)
        fired = np.bincount(step, minlength=len(inside))
        begun_us = np.full(len(inside), window_us)
        np.minimum.at(begun_us, step, since_us)
        starts_late = first_us > inside[0] and begun_us[0] > _LATER * begun_us[1:].max()
        ends_early = last_us < inside[-1] + window_us / 2 and fired[-1] < _WHOLE * fired[:-1].mean()
        inside = inside[int(starts_late) : len(inside) - int(ends_early)]
    if len(inside) < _MIN_STEPS:
        answered = f"covers the response to {len(inside)} of {len(rises_us)} steps"
        span = f"--steps: the recording, {first_us} to {last_us} us, {answered}"
        raise TaskError(f"{span}, expected at least {_MIN_STEPS}")
    return inside


def _estimates(answers: _Answers) -> tuple[int, Estimate, Estimate]:
    """Return the number of poles, their cutoff and the latency."""
    since_us, tile = answers.since_us, answers.tile
    edges_us = np.unique(np.quantile(since_us, np.linspace(0, _TAIL, 4 * _POINTS)).round())
    t_s = edges_us * 1e-6
    tiles = int(tile.max()) + 1
    bins = np.searchsorted(edges_us, since_us, side="right")
    counted = np.zeros((tiles, len(edges_us) + 1))
    np.add.at(counted, (tile[answers.place], bins), 1.0)
    pixels = np.bincount(tile, minlength=tiles).astype(np.float64)

    def mean_events(weights: Float64) -> Float64:
        return np.cumsum(weights @ counted)[: len(t_s)] / (weights @ pixels * answers.steps)

    whole = mean_events(np.ones(tiles))
    if (points := int(np.sum(whole >= _FROM + 0.5))) < _MIN_POINTS:
        times = f"--steps: found {points} distinct event times after a step"
        raise TaskError(
            f"{times}, expected at least {_MIN_POINTS}; use a recording with finer timestamps"
        )
    fits = {order: _fit(t_s, whole, order, _FROM, _ABSORBED) for order in (1, 2)}
    order = min(fits, key=lambda order: fits[order].cost)
    absorbed = None if order == 2 else _ABSORBED
    best = _fit(t_s, whole, order, _FROM, absorbed)
    others = [_fit(t_s, whole, order, _FROM + 0.5, absorbed)]
    if order == 1:
        others += [_fit(t_s, whole, order, _FROM, B) for B in _ABSORBED_RANGE]
    rng = np.random.default_rng(0)
    draws = rng.multinomial(tiles, np.full(tiles, 1 / tiles), _DRAWS).astype(np.float64)
    # Tiles with little light may be drawn alone.
    curves = [curve for curve in map(mean_events, draws) if np.sum(curve >= _FROM) >= _MIN_POINTS]
    if len(curves) < _DRAWS / 2:
        raise TaskError("--steps: too few pixels have several ON events after a step")
    drawn = [_fit(t_s, curve, order, _FROM, absorbed, best)[:2] for curve in curves]
    low, high = np.percentile(np.array(drawn), (2.5, 97.5), axis=0).tolist()
    wide = [max(abs(other[k] - best[k]) for other in others) for k in range(2)]
    cutoff, latency = (Estimate(best[k], low[k], high[k]).widened(wide[k]) for k in range(2))
    return order, cutoff, latency


class _Fit(NamedTuple):
    cutoff_hz: float
    latency_s: float
    cost: float


def _fit(
    t_s: Float64,
    events: Float64,
    order: int,
    least: float,
    absorbed: float | None,
    start: _Fit | None = None,
) -> _Fit:
    """Fit the response of the poles to the mean number of events from `least` on.

    A, and B unless it is given as `absorbed`, follow from a and the latency by linear regression.
    """
    used = np.flatnonzero(events >= least)
    used = used[np.unique(np.linspace(0, len(used) - 1, _POINTS).astype(int))]
    t_s, n = t_s[used], events[used]

    def left(parameters: Float64) -> Float64:
        a, latency = math.exp(parameters[0]), parameters[1] / math.exp(parameters[0])
        y = np.maximum(a * (t_s - latency), 0.0)
        g = 1 - (1 + y if order == 2 else 1.0) * np.exp(-y)
        dg, dn = (g - g.mean(), n - n.mean()) if absorbed is None else (g, n + absorbed)
        return dg * (dg @ dn / max(dg @ dg, 1e-300)) - dn

    if start is None:
        half_s = float(np.interp(0.5 * (n[0] + n[-1]), n, t_s))
        guess = [math.log((1.68 if order == 2 else 0.69) / max(half_s, 1e-9)), 0.0]
    else:
        a = 2 * math.pi * start.cutoff_hz
        guess = [math.log(a), max(0.0, a * start.latency_s)]
    bounds = [-np.inf, 0.0], [np.inf, np.inf]
    result = optimize.least_squares(left, guess, x_scale=[0.1, 0.1], bounds=bounds)
    a = math.exp(result.x[0])
    return _Fit(a / (2 * math.pi), float(result.x[1]) / a, float(result.cost))
