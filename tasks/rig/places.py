"""Places along a print, and the windows of time in which a crop is there."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tasks.errors import RigError
from tasks.rig.calibration import on_page
from tasks.rig.crop import Cropped
from tasks.rig.slider import Slider

Float64 = NDArray[np.float64]

_EVEN = 1e-3  # largest deviation from constant speed in a window, as a fraction of the travel
_EVEN_IN_STEPS = 5e-3  # the same where the encoder's steps are coarser
_CHECKED = 5  # positions in a window
_APART_M = 0.1  # two positions of the slider, between which the page is a straight line


@dataclass(frozen=True, slots=True)
class Window:
    """A time window of constant speed at a place.

    Parameters
    ----------
    visit
        2 n on the carriage's way there, for the nth time from 0, and 2 n + 1 on its way back.
    x_m
        The encoder's readings then, m.
    """

    place: int
    visit: int
    start_us: int
    end_us: int
    x_m: tuple[float, float]

    @property
    def back(self) -> int:
        """1 on the carriage's way back, and 0 on its way there."""
        return self.visit % 2

    @property
    def encoder_mps(self) -> float:
        """Speed by the encoder, whose scale `eres rig solve --scale` finds."""
        return 1e6 * abs(self.x_m[1] - self.x_m[0]) / (self.end_us - self.start_us)


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """Which part of the print is in the middle of a crop at each position of its slider.

    Parameters
    ----------
    begin_m, slope
        Position along the print at the slider's 0, m, and change with that of the slider.
    """

    slider: Slider
    first_us: int
    last_us: int
    scale: float
    begin_m: float
    slope: float
    _reached_m: tuple[float, float] = field(init=False)  # lowest and highest reading

    def __post_init__(self) -> None:
        t_us, x_m = self.slider.t_us, self.slider.x_m
        first_us = max(self.first_us, math.ceil(t_us[0]))
        last_us = min(self.last_us, math.floor(t_us[-1]))
        if first_us >= last_us:
            raise RigError("slider: the readings and the events do not overlap in time")
        inside = x_m[(t_us >= first_us) & (t_us <= last_us)]
        x = [*self.slider.position_m([first_us, last_us]).tolist(), *inside.tolist()]
        if min(x) == max(x):
            raise RigError(f"slider: the carriage stays at {x[0]:g} m during the events")
        object.__setattr__(self, "first_us", first_us)
        object.__setattr__(self, "last_us", last_us)
        object.__setattr__(self, "_reached_m", (min(x), max(x)))

    @classmethod
    def of(cls, cropped: Cropped, slider: Slider, span_us: tuple[int, int], along: Float64) -> Way:
        """Return the way of a crop.

        Parameters
        ----------
        along
            (2,) unit vector of the travel on the page.
        """
        pose, middle_px = cropped.pose.pose(), 0.5 * np.array([[cropped.width, cropped.height]])
        at = [on_page(pose, cropped.camera(), middle_px, x)[0] @ along for x in (0.0, _APART_M)]
        slope = float(at[1] - at[0]) / _APART_M
        return cls(slider, *span_us, pose.scale, float(at[0]), slope)

    @property
    def span_m(self) -> tuple[float, float]:
        """First and last position along the print during the events, m."""
        ends = [self.begin_m + self.slope * x for x in self._reached_m]
        return min(ends), max(ends)

    def slider_m(self, position_m: ArrayLike) -> Float64:
        """Return the slider's positions, m, at positions along the print, m."""
        return np.asarray((np.asarray(position_m) - self.begin_m) / self.slope)

    def windows(self, places_m: Float64, travel_m: float) -> list[Window]:
        """Return the windows of constant speed, in the order of their starts.

        Parameters
        ----------
        places_m
            (K,) positions along the print, m.
        travel_m
            Travel in a window, m; a place is in its middle.
        """
        half_m = 0.5 * travel_m / self.scale
        moves_m = np.abs(np.diff(self.slider.x_m))
        step = float(moves_m[moves_m > 0].min()) / (2 * half_m)
        uneven_m = 2 * half_m * min(max(step, _EVEN), _EVEN_IN_STEPS)
        windows: list[Window] = []
        for place, middle_m in enumerate(self.slider_m(places_m).tolist()):
            passed: Counter[bool] = Counter()
            for start, end, rises in _passes(self.slider, middle_m - half_m, middle_m + half_m):
                start_us, end_us = round(start), round(end)
                back = rises != (self.slope > 0)
                visit = 2 * passed[back] + back
                passed[back] += 1
                if not self.first_us <= start_us < end_us <= self.last_us:
                    continue
                x = self.slider.position_m(np.linspace(start_us, end_us, _CHECKED))
                if np.max(np.abs(x - np.linspace(x[0], x[-1], _CHECKED))) < uneven_m:
                    at = float(x[0]), float(x[-1])
                    windows.append(Window(place, visit, start_us, end_us, at))
        return sorted(windows, key=lambda window: window.start_us)


def _passes(slider: Slider, low_m: float, high_m: float) -> list[tuple[float, float, bool]]:
    """Return start and end, us, of each way between two positions, and whether it is upward.

    An encoder that jitters crosses a position several times: the last time before the other
    position counts, and the first time there.
    """
    low_us, high_us = _crossings(slider, low_m), _crossings(slider, high_m)
    t_us = np.concatenate([low_us, high_us])
    is_high = np.repeat([False, True], [len(low_us), len(high_us)])
    order = np.argsort(t_us, kind="stable")
    t_us, is_high = t_us[order], is_high[order]
    k = np.flatnonzero(is_high[1:] != is_high[:-1])
    return list(zip(t_us[k].tolist(), t_us[k + 1].tolist(), is_high[k + 1].tolist(), strict=True))


def _crossings(slider: Slider, x_m: float) -> Float64:
    """Return the times at which the carriage crosses a position, us."""
    beyond = slider.x_m >= x_m
    k = np.flatnonzero(beyond[1:] != beyond[:-1])
    share = (x_m - slider.x_m[k]) / (slider.x_m[k + 1] - slider.x_m[k])
    return np.asarray(slider.t_us[k] + share * (slider.t_us[k + 1] - slider.t_us[k]))
