"""Noise and hot pixels, from a stretch in which nothing moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from sensor import Events
from sensor.representations import event_counts
from tasks.errors import TaskError
from tasks.numerics.estimate import Estimate, poisson_rate, share

HOT = 10.0  # times the mean rate of the other pixels
_CHANCE = 0.01  # probability that any pixel of a sensor without hot pixels is taken for hot
_PASSES = 20
_WINDOWS = 5


class Noise(NamedTuple):
    """Noise of a sensor, from a still stretch.

    Parameters
    ----------
    leak_hz, shot_noise_hz
        Rates of a pixel that is not hot: shot noise fires ON and OFF equally, leakage only ON.
    hot_pixels
        Share of hot pixels.
    hot_pixel_hz
        Their mean rate above that of the others, None if there are none.
    hot
        (H, W) bool, which pixels are hot.
    """

    leak_hz: Estimate
    shot_noise_hz: Estimate
    hot_pixels: Estimate
    hot_pixel_hz: Estimate | None
    hot: NDArray[np.bool_]


def counts(events: Events) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the ON and the OFF events of each pixel, (H, W) each."""
    off, on = event_counts(events)
    return on, off


def fit_noise(on: NDArray[np.integer], off: NDArray[np.integer], seconds: float) -> Noise:
    """Estimate noise from the events of a still scene in constant light.

    A pixel is hot if it fires more than ten times as often as the mean of the others, and more than
    the most active pixel would in 99 of 100 sensors of this size, if all were Poisson processes of
    that mean.

    Parameters
    ----------
    on, off
        (H, W) ON and OFF events of each pixel.
    seconds
        Length of the stretch.

    Returns
    -------
    Noise

    Raises
    ------
    TaskError
        The stretch has no length.
    """
    if not seconds > 0:
        raise TaskError(f"--still: found {seconds:g} s, expected a duration above 0")
    total = on.astype(np.int64) + off
    hot = np.zeros(total.shape, bool)
    for _ in range(_PASSES):
        mean = float(total[~hot].mean())
        most = max(HOT * mean, float(stats.poisson.isf(_CHANCE / total.size, mean)))
        before, hot = hot, total > most
        if np.array_equal(hot, before):
            break
    exposure = seconds * float((~hot).sum())
    ons, offs = on[~hot].astype(np.float64), off[~hot].astype(np.float64)
    off_rate = poisson_rate(float(offs.sum()), exposure, _dispersion(offs))
    spread = 1.96 * np.sqrt(ons.sum() * _dispersion(ons) + offs.sum() * _dispersion(offs) + 1)
    surplus = float(ons.sum() - offs.sum())
    leak = Estimate(*(max(0.0, surplus + way * spread) / exposure for way in (0, -1, 1)))
    hot_rate = None
    if hot.any():
        all_hot = poisson_rate(float(total[hot].sum()), seconds * int(hot.sum()))
        hot_rate = Estimate(*(max(0.0, rate - mean / seconds) for rate in all_hot))
    shot_noise = Estimate(*(2 * rate for rate in off_rate))
    return Noise(leak, shot_noise, share(int(hot.sum()), total.size), hot_rate, hot)


def neighbors_together(events: Events, hot: NDArray[np.bool_]) -> float:
    """Return the correlation between the events of neighbors over time.

    Noise is independent in each pixel. Motion and flicker make neighbors fire together, or one
    after the other.

    Parameters
    ----------
    events
        Events of the stretch.
    hot
        (H, W) bool, pixels to leave out.

    Returns
    -------
    float
        Correlation of the numbers of events of neighbors in fifths of the stretch, horizontal or
        vertical, whichever is larger: 0 for noise, -1 to 1.
    """
    edges_us = np.linspace(events.t_us[0], events.t_us[-1] + 1, _WINDOWS + 1)
    window = np.searchsorted(edges_us, events.t_us, "right") - 1
    height, width = hot.shape
    place = (window * height + events.y) * width + events.x
    count = np.bincount(place, minlength=_WINDOWS * height * width).astype(np.float32)
    count = count.reshape(_WINDOWS, height, width)
    count -= count.mean(axis=0)  # pixels differ in their rates
    count[:, hot] = 0.0
    variance = float(np.mean(np.square(count)))
    if variance == 0:
        return 0.0
    pairs = (count[:, :, 1:], count[:, :, :-1]), (count[:, 1:], count[:, :-1])
    means = (float(np.mean(a * b)) / variance for a, b in pairs if a.size)  # none in a single row
    return max(means, key=abs, default=0.0)


def _dispersion(counts: NDArray[np.float64]) -> float:
    """Return variance over mean, at least 1: pixels differ in their thresholds."""
    mean = float(counts.mean())
    return max(1.0, float(counts.var()) / mean) if mean > 0 else 1.0
