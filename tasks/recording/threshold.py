"""Contrast thresholds from frames and events: see `tasks.recording.levels`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from tasks.errors import TaskError
from tasks.numerics.estimate import Estimate, bootstrap
from tasks.recording.frames import DARK, Frames
from tasks.recording.levels import Levels, busiest, levels_of, light_between
from tasks.recording.pairs import PairSums
from tasks.recording.recording import Recording, cut

_PIXELS = 0.04  # effect of thresholds that differ between pixels by 10 %, in simulations
_PASSES = 6
_HUBER = 1.345  # standard deviations
_DELAYS = 21  # tried before the search


class Thresholds(NamedTuple):
    """Contrast thresholds of a camera.

    Parameters
    ----------
    on, off
        Of brighter and darker events, log units.

    Examples
    --------
    >>> from tasks.recording.threshold import Thresholds
    >>> Thresholds(on=0.25, off=0.5).mean
    0.375
    """

    on: float
    off: float

    @property
    def mean(self) -> float:
        """One threshold for both polarities."""
        return 0.5 * (self.on + self.off)

    def change(self, found: PairSums) -> NDArray[np.float64]:
        """Return the change of log intensity of the events, (H, W)."""
        return self.on * found.on - self.off * found.off


ANY_THRESHOLDS = Thresholds(0.2, 0.2)
"""Where nothing is known of the camera."""


def stored_thresholds(recording: Recording) -> Thresholds | None:
    """Return the thresholds of the sensor in a file of simulated events, None if there is none."""
    model = recording.header.model
    return None if model is None else Thresholds(model.contrast_threshold, model.off_threshold)


class FittedThresholds(NamedTuple):
    """Contrast thresholds with their intervals, at one dark level.

    Parameters
    ----------
    on, off
        Of brighter and darker events, log units.
    dark
        Dark level, in units of white.
    unexplained
        Share of the squared change of the light from event to event that the thresholds do not
        explain.
    events
        Number of events.
    """

    on: Estimate
    off: Estimate
    dark: float
    unexplained: float
    events: int

    @property
    def values(self) -> Thresholds:
        """The thresholds without their intervals."""
        return Thresholds(self.on.value, self.off.value)


def fit_recording(recording: Recording, frames: Frames) -> FittedThresholds:
    """Fit the contrast thresholds to the frames of a recording, in the stretch with most events.

    Parameters
    ----------
    recording, frames
        The events and frames; the events of at most 200 frames are in memory.

    Returns
    -------
    FittedThresholds
        At the dark level of `tasks.recording.frames.DARK`.

    Raises
    ------
    TaskError
        The events do not explain the change of the frames.
    """
    kept = busiest(recording.parts(), frames)
    window_us = int(kept.middle_us[0]), int(kept.middle_us[-1])
    events = next(cut(recording.parts(), [window_us]))
    both = kept, kept.every_second()
    levels, coarse = (levels_of(events, light_between(one), DARK) for one in both)
    return fit_thresholds(levels, coarse, best_delay_us(levels))


def best_delay_us(levels: Levels) -> float:
    """Return how late the events are: the delay at which thresholds explain the light best.

    Parameters
    ----------
    levels
        Events with their light.

    Returns
    -------
    Within a twentieth of the time of the light, microseconds; negative if frames are late.
    """
    reach_us = 0.5 * levels.settling_us
    tried_us = np.linspace(-reach_us, reach_us, _DELAYS)
    left = [fit_line(levels, delay_us).unexplained for delay_us in tried_us.tolist()]
    best, step_us = float(tried_us[int(np.argmin(left))]), float(tried_us[1] - tried_us[0])
    found = optimize.minimize_scalar(
        lambda delay_us: fit_line(levels, delay_us).unexplained,
        bounds=(max(-reach_us, best - step_us), min(reach_us, best + step_us)),
        method="bounded",
        options={"xatol": 1.0},
    )
    return float(found.x)


class Line(NamedTuple):
    """Thresholds by robust least squares, log units."""

    on: float
    off: float
    unexplained: float
    sums: NDArray[np.float64]  # (tiles, 6) of the normal equations


def fit_line(levels: Levels, delay_us: float = 0.0, pole_s: float = 0.0, poles: int = 2) -> Line:
    """Fit both thresholds by robust regression of the light on the numbers of events.

    Each block of events of a pixel has an unknown level; subtracting the block's mean removes it.
    Huber's weights bound the effect of outliers.

    Parameters
    ----------
    levels
        Events with their light.
    delay_us, pole_s, poles
        As in `Levels.light_at_events`.

    Returns
    -------
    Line
        NaN if the events do not separate ON from OFF.
    """
    y = levels.within_blocks(levels.light_at_events(delay_us, pole_s, poles))
    a, b = levels.within_blocks(levels.on), -levels.within_blocks(levels.off)
    products = np.stack([a * a, a * b, b * b, a * y, b * y, y * y])
    weight = np.ones(len(y))
    for _ in range(_PASSES):
        C_on, C_off = _solved((products * weight).sum(axis=1))
        if not np.isfinite(C_on):
            break
        left = np.abs(y - C_on * a - C_off * b)
        scale = max(1.4826 * float(np.median(left)), 1e-12)
        weight = np.minimum(1.0, _HUBER * scale / np.maximum(left, 1e-12))
    each = [np.bincount(levels.unit, one) for one in weight * products]
    sums = np.stack(each, axis=1).astype(np.float64)
    total = sums.sum(axis=0)
    C_on, C_off = _solved(total)
    unexplained = 1 - float(C_on * total[3] + C_off * total[4]) / max(float(total[5]), 1e-300)
    return Line(float(C_on), float(C_off), unexplained, sums)


def _solved(total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve the normal equations; NaN if they are singular."""
    aa, ab, bb, ay, by = total[:5]
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return np.full(2, np.nan)
    solution: NDArray[np.float64] = np.array([bb * ay - ab * by, aa * by - ab * ay]) / determinant
    return solution


def misfit() -> TaskError:
    """Return the error of events from which no thresholds follow."""
    return TaskError(
        "thresholds: found changes of the light that do not fit the events, expected frames on "
        "the clock of the events, and light that rises and falls"
    )


def fit_thresholds(
    levels: Levels, coarse: Levels, delay_us: float = 0.0, pole_s: float = 0.0, poles: int = 2
) -> FittedThresholds:
    """Estimate both thresholds.

    The interval is that of a bootstrap over tiles of pixels, widened by the change of the answer
    with every second frame, which shows the error of the light between frames, and by 4 % for
    thresholds that differ between pixels by up to 10 %. If all that stays unexplained is change
    between the frames that they do not show, the thresholds are too low by that share; so their
    upper ends are higher by it.

    Parameters
    ----------
    levels
        Events with their light.
    coarse
        The same with light from every second frame.
    delay_us, pole_s, poles
        As in `Levels.light_at_events`.

    Returns
    -------
    FittedThresholds

    Raises
    ------
    TaskError
        The changes of the light do not fit the events, or do not separate ON from OFF, for example
        because all light rises.
    """
    found = fit_line(levels, delay_us, pole_s, poles)
    if not np.isfinite(found.on):
        raise misfit()
    both = bootstrap(found.sums, _solved)
    if not all(one.low > 0 for one in both):
        raise misfit()
    half = fit_line(coarse, delay_us, pole_s, poles)
    C_on, C_off = (
        one.widened(_PIXELS * one.value + abs(other - one.value)).raised(found.unexplained)
        for one, other in zip(both, (half.on, half.off), strict=True)
    )
    return FittedThresholds(C_on, C_off, levels.dark, found.unexplained, len(levels))
