"""Contrast thresholds from frames and events: see `tasks.recording.levels`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tasks.numerics.estimate import Estimate
from tasks.recording.frames import DARK, RecordedFrames
from tasks.recording.levels import Levels, busiest, fit_line, levels_of, light_between
from tasks.recording.motion import lag
from tasks.recording.recording import Recording, cut

_PIXELS = 0.04  # effect of thresholds that differ between pixels by 10 %, in simulations


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

    def change(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the change of log intensity, (H, W), of (2, H, W) sums of ON and OFF events."""
        return self.on * sums[0] - self.off * sums[1]


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


def fit_recording(recording: Recording, frames: RecordedFrames) -> FittedThresholds:
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
    frames = busiest(recording.parts(), frames)
    window_us = int(frames.middle_us[0]), int(frames.middle_us[-1])
    events = next(cut(recording.parts(), [window_us]))
    both = frames, frames.every_second()
    levels, coarse = (levels_of(events, light_between(each), DARK) for each in both)
    return fit_thresholds(levels, coarse, *lag(levels))


def fit_thresholds(
    levels: Levels, coarse: Levels, delay_us: float = 0.0, pole_s: float = 0.0, poles: int = 2
) -> FittedThresholds:
    """Estimate both thresholds.

    The interval is a bootstrap over tiles of pixels. It is widened by the change of the estimate
    with every second frame, which shows the error of the light between frames, and by 4 % for
    thresholds that differ by up to 10 % between pixels. The unexplained change of the light may be
    change that the frames do not show. The thresholds are then too low by that share, so the upper
    ends are raised by it.

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
    line = fit_line(levels, delay_us, pole_s, poles)
    half = fit_line(coarse, delay_us, pole_s, poles)
    C_on, C_off = (
        C.widened(_PIXELS * C.value + abs(other - C.value)).raised(line.unexplained)
        for C, other in zip(line.thresholds(), (half.on, half.off), strict=True)
    )
    return FittedThresholds(C_on, C_off, levels.dark, line.unexplained, len(levels))
