"""Contrast thresholds, from frames and the events between them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sensor import Events
from tasks.errors import TaskError
from tasks.fitting.estimate import Estimate, bootstrap, tiles_of

DARK_SHARES = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)
"""Dark levels of the sweep, shares of white."""

_NEAR = 0.05  # of the time between frames: an event so close to a frame has the light of the frame
_MIXED = 0.1  # share of the events of the rarer sign, at most
_LEAST = 100  # changes
_PIXELS = 0.03  # effect of thresholds that differ between pixels by 10 %, in simulations
_PASSES = 12
_HUBER = 1.345  # standard deviations
_SATURATED = 0.98  # of the brightest value


class Changes(NamedTuple):
    """Changes of the light of a pixel from an event near a frame to the next such event.

    Parameters
    ----------
    before, after
        (N,) light in these frames, white at 1.
    on, off
        (N,) events after the first of the two, up to and with the second.
    away
        (N,) distance of the frames from their events, the larger one, in times between frames.
    tile
        (N,) tile of the pixel.
    """

    before: NDArray[np.float64]
    after: NDArray[np.float64]
    on: NDArray[np.float64]
    off: NDArray[np.float64]
    away: NDArray[np.float64]
    tile: NDArray[np.int64]


class Thresholds(NamedTuple):
    """Thresholds of ON and OFF events, log units, at one dark level."""

    on: Estimate
    off: Estimate
    dark_share: float


def counts(events: Events) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ON and the OFF events of each pixel, (H, W) each."""
    place = events.y.astype(np.int64) * events.width + events.x
    shape = events.height, events.width
    on, off = (
        np.bincount(place[events.p == p], minlength=shape[0] * shape[1]).reshape(shape)
        for p in (1, -1)
    )
    return on, off


def changes_between(
    frames: Iterable[NDArray[np.floating]],
    t_us: NDArray[np.int64],
    events: Events,
    white: float,
    hot: NDArray[np.bool_] | None = None,
) -> Changes:
    """Find changes of the light whose events are known.

    At an event the log intensity of a pixel is exactly at a level of its comparator. So from one
    event to another it changes by C for each event, without a remainder, and whichever way the
    light took. A frame has the light of an event that comes within 5 % of the time between frames.
    Saturated and hot pixels are left out, and changes with many events of both signs: there the
    thresholds of a pixel, which differ from the mean, decide more than the light.

    Parameters
    ----------
    frames
        (H, W) linear light each, at least two.
    t_us
        (F,) their times, on the clock of the events.
    events
        The events.
    white
        Light of white.
    hot
        (H, W) pixels to leave out.

    Returns
    -------
    Changes

    Raises
    ------
    TaskError
        A frame has another size than the sensor, or the frames and events do not overlap.
    """
    pixel = events.y.astype(np.int64) * events.width + events.x
    if hot is not None:
        kept = ~hot.ravel()[pixel]
        events, pixel = events.where(kept), pixel[kept]
    order = np.argsort(pixel, kind="stable")  # by pixel, then time
    pixel, since_us = pixel[order], events.t_us[order]
    ons = np.cumsum(events.p[order] > 0)
    frame, near = _nearest(t_us, since_us)
    first = np.concatenate(([True], (pixel[1:] != pixel[:-1]) | (frame[1:] != frame[:-1])))
    group = np.cumsum(first) - 1
    closest = np.lexsort((near, group))[np.flatnonzero(first)]  # one event for pixel and frame
    anchors = closest[np.isfinite(near[closest])]
    light = _light_at(frames, frame[anchors], pixel[anchors], (events.height, events.width))
    good = light < _SATURATED * light.max(initial=0.0)
    anchors, light = anchors[good], light[good] / white
    a, b = anchors[:-1], anchors[1:]
    on = ons[b] - ons[a]
    off = b - a - on
    used = (pixel[a] == pixel[b]) & (np.minimum(on, off) <= _MIXED * (on + off))
    a, b = a[used], b[used]
    if len(a) < _LEAST:
        raise TaskError(
            f"frames: found {len(a)} changes between events near frames, expected at least "
            f"{_LEAST}: frames on the clock of the events, and a scene that moves"
        )
    return Changes(
        before=light[:-1][used],
        after=light[1:][used],
        on=on[used].astype(np.float64),
        off=off[used].astype(np.float64),
        away=np.maximum(near[a], near[b]),
        tile=tiles_of(pixel[b] // events.width, pixel[b] % events.width, events.width),
    )


def _nearest(
    t_us: NDArray[np.int64], event_us: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nearest frame of each event, and its distance in times between frames.

    The distance is inf if the frame is not near.
    """
    middles = t_us[:-1] + np.diff(t_us) / 2
    frame = np.searchsorted(middles, event_us)
    gaps = np.diff(t_us).astype(np.float64)
    shorter = np.minimum(np.append(gaps, np.inf), np.insert(gaps, 0, np.inf))
    away = np.abs(event_us - t_us[frame]) / shorter[frame]
    away[away > _NEAR] = np.inf
    return frame, away


def _light_at(
    frames: Iterable[NDArray[np.floating]],
    frame: NDArray[np.int64],
    pixel: NDArray[np.int64],
    shape: tuple[int, int],
) -> NDArray[np.float64]:
    """Return the light of pixels in frames, reading each frame once."""
    order = np.argsort(frame, kind="stable")
    light = np.zeros(len(frame))
    start = 0
    for k, image in enumerate(frames):
        if image.shape != shape:
            raise TaskError(
                f"frame {k}: found {image.shape[1]}x{image.shape[0]} px, expected "
                f"{shape[1]}x{shape[0]}, the size of the sensor"
            )
        stop = start + int(np.searchsorted(frame[order[start:]], k, side="right"))
        here = order[start:stop]
        light[here] = image.ravel()[pixel[here]]
        start = stop
    return light


def fit_thresholds(changes: Changes, dark_share: float) -> Thresholds:
    """Estimate both thresholds by robust regression of changes on events.

    A change of log(I + I_dark) is C_on times the ON events less C_off times the OFF events. Its
    variance is taken as proportional to the number of events, and Huber's weights bound the effect
    of outliers. The interval is that of a bootstrap over tiles of pixels, widened by twice the
    change of the answer with only those events that are half as far from their frames: the light
    moves on in the meantime, in proportion to the distance. Three percent are added
    for thresholds that differ between pixels by up to 10 %.

    Parameters
    ----------
    changes
        From `changes_between`.
    dark_share
        I_dark, share of white.

    Returns
    -------
    Thresholds

    Raises
    ------
    TaskError
        The changes do not tell ON from OFF, as where all light rises.
    """
    by_tile = _sums_of(changes, dark_share)
    both = bootstrap(by_tile, _solved)
    closer = changes.away <= 0.5 * _NEAR
    before, after, on, off, away, tile = changes
    nearer = Changes(
        *(before[closer], after[closer], on[closer], off[closer], away[closer]), tile[closer]
    )
    half = _solved(_sums_of(nearer, dark_share).sum(axis=0))
    if not all(one.low > 0 for one in both):
        raise TaskError(
            "thresholds: found changes of the light that do not fit the events, expected frames on "
            "the clock of the events, and light that rises and falls"
        )
    wide = [
        _PIXELS * one.value + (2 * abs(other - one.value) if np.isfinite(other) else 0.0)
        for one, other in zip(both, half.tolist(), strict=True)
    ]
    C_on, C_off = (
        Estimate(one.value, max(0.0, one.low - more), one.high + more)
        for one, more in zip(both, wide, strict=True)
    )
    return Thresholds(C_on, C_off, dark_share)


def _sums_of(changes: Changes, dark_share: float) -> NDArray[np.float64]:
    """Return the sums of the normal equations of each tile, (tiles, 5), with Huber's weights."""
    change = np.log((changes.after + dark_share) / (changes.before + dark_share))
    on, off, events = changes.on, -changes.off, changes.on + changes.off
    products = np.stack([on * on, on * off, off * off, on * change, off * change])
    weight = 1 / events
    for _ in range(_PASSES):
        C_on, C_off = _solved((weight * products).sum(axis=1))
        if not np.isfinite(C_on):
            break
        left = np.abs(change - C_on * on - C_off * off) / np.sqrt(events)
        scale = max(1.4826 * float(np.median(left)), 1e-12)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(left, 1e-12)) / events
    _, place = np.unique(changes.tile, return_inverse=True)
    return np.stack([np.bincount(place, one) for one in weight * products], axis=1)


def _solved(total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve the normal equations; NaN if they are singular."""
    aa, ab, bb, ay, by = total
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return np.full(2, np.nan)
    solution: NDArray[np.float64] = np.array([bb * ay - ab * by, aa * by - ab * ay]) / determinant
    return solution
