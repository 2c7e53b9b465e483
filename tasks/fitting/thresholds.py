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

_FAR = 1.5  # thresholds: after such a change the pixel has fired, whatever its memory was
_NEAR = 0.5  # thresholds: a smaller change says little about them
_LEAST = 100  # changes of each sign
_PASSES = 12
_HUBER = 1.345  # standard deviations
_ROUNDING = 0.4  # events: about the standard deviation of rounding
_SATURATED = 0.98  # of the brightest value
_MOST = 4_000_000  # changes; of more, those of random pixels are used


class Changes(NamedTuple):
    """Light of pixels in three frames in a row, and their events between the last two.

    Attributes
    ----------
    earlier, before, after
        (N,) light, white at 1.
    on, off
        (N,) events from `before` to `after`.
    tile
        (N,) tile of the pixel.
    """

    earlier: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    on: NDArray[np.float64]
    off: NDArray[np.float64]
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
    """Count the events of each pixel between frames.

    Saturated and hot pixels are left out. Of long recordings a random share of the pixels is used.

    Parameters
    ----------
    frames
        (H, W) linear light each, at least three.
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
    shape = events.height, events.width
    kept = np.random.default_rng(0).random(shape) * len(t_us) * (shape[0] * shape[1]) < _MOST
    if hot is not None:
        kept &= ~hot
    y, x = np.nonzero(kept)
    tile = tiles_of(y, x, events.width)
    found = []
    last: list[NDArray[np.floating]] = []
    brightest = 0.0
    first_us, last_us = map(int, events.t_us[[0, -1]])
    for k, frame in enumerate(frames):
        if frame.shape != shape:
            raise TaskError(
                f"frame {k}: found {frame.shape[1]}x{frame.shape[0]} px, expected "
                f"{events.width}x{events.height}, the size of the sensor"
            )
        brightest = max(brightest, float(frame.max()))
        last = [*last[-2:], frame]
        if len(last) == 3 and first_us <= t_us[k - 1] and t_us[k] <= last_us:
            part = events.between(int(t_us[k - 1]), int(t_us[k]))
            on, off = counts(part)
            light = [one[y, x].astype(np.float32) for one in last]
            found.append((*light, on[y, x], off[y, x], tile))
    if sum(int(one[3].sum() + one[4].sum()) for one in found) < 2 * _LEAST:
        raise TaskError(
            "frames: found too few events between frames, expected three frames or more on the "
            "clock of the events and a scene that moves"
        )
    *light, on, off, tile = (np.concatenate(column) for column in zip(*found, strict=True))
    lit = np.maximum.reduce(light) < _SATURATED * brightest
    earlier, before, after = (one[lit].astype(np.float64) / white for one in light)
    return Changes(
        earlier, before, after, on[lit].astype(np.float64), off[lit].astype(np.float64), tile[lit]
    )


def fit_thresholds(changes: Changes, dark_share: float) -> Thresholds:
    """Estimate both thresholds by robust regression of events on changes.

    After a rise by more than 1.5 C the memory of a pixel is less than C below its log intensity, by
    an amount that is uniform over many pixels. If the light rises further, by D in log(I + I_dark),
    the mean number of events is D / C: C is the sum of the changes over that of the events. The
    same holds for falls. Events of the other sign count as negative, with the ratio of the
    thresholds. Huber's weights bound the effect of outliers. The interval is that of a bootstrap
    over tiles of pixels.

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
        There are too few changes beyond 1.5 C.
    """
    light = (changes.earlier, changes.before, changes.after)
    earlier, before, after = (np.log(one + dark_share) for one in light)
    previous, change = before - earlier, after - before
    C_on = C_off = float(np.abs(change).sum() / (changes.on + changes.off).sum())
    for _ in range(_PASSES):
        ratio, far = C_off / C_on, _FAR * max(C_on, C_off)
        rises = (previous > far) & (change > _NEAR * C_on)
        falls = (previous < -far) & (change < -_NEAR * C_off)
        net = changes.on - ratio * changes.off
        on = _Ratio(change[rises], net[rises], changes.tile[rises])
        off = _Ratio(-change[falls], -net[falls] / ratio, changes.tile[falls])
        C_on, C_off = on.threshold, off.threshold
    return Thresholds(on.estimate(), off.estimate(), dark_share)


class _Ratio:
    """The change that fires one event, robust to outliers."""

    def __init__(
        self, change: NDArray[np.float64], events: NDArray[np.float64], tile: NDArray[np.int64]
    ) -> None:
        if len(change) < _LEAST:
            raise TaskError(
                f"thresholds: found {len(change)} pixels that went on rising or falling over three "
                f"frames, expected at least {_LEAST}: more frames, or a scene with more contrast"
            )
        weight = np.ones_like(change)
        for _ in range(_PASSES):
            C = self._threshold(self._sums(weight, change, events).sum(axis=1))[0]
            left = np.abs(events - change / C)
            scale = max(1.4826 * float(np.median(left)), _ROUNDING)
            weight = np.minimum(1.0, _HUBER * scale / np.maximum(left, 1e-12))
        _, place = np.unique(tile, return_inverse=True)
        sums = self._sums(weight, change, events)
        self._by_tile = np.stack([np.bincount(place, one) for one in sums], axis=1)
        self.threshold = float(self._threshold(self._by_tile.sum(axis=0))[0])

    @staticmethod
    def _sums(
        weight: NDArray[np.float64], change: NDArray[np.float64], events: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        return np.stack([weight * change, weight * events])

    @staticmethod
    def _threshold(total: NDArray[np.float64]) -> NDArray[np.float64]:
        if not total[1] > 0:
            raise TaskError(
                "thresholds: found no events where the light changes, expected frames on the clock "
                "of the events"
            )
        return total[:1] / total[1]

    def estimate(self) -> Estimate:
        """Return C with its interval."""
        return bootstrap(self._by_tile, self._threshold)[0]
