"""Places along a print, and the windows of time in which a crop is there."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tasks.errors import RigError
from tasks.rig.calibration import on_page
from tasks.rig.crop import Cropped
from tasks.rig.slider import Slider

Float64 = NDArray[np.float64]

_EVEN = 1e-3  # largest deviation from constant speed within a window, as a fraction of the travel
_CHECKED = 5  # positions in a window


@dataclass(frozen=True, slots=True)
class Window:
    """A time window of constant speed at a place.

    Parameters
    ----------
    place
        Number of the place, which all recordings of the print share.
    visit
        2 n on the carriage's way there, for the nth time from 0, and 2 n + 1 on its way back.
    start_us, end_us
        Start and end.
    x_m
        The encoder's readings then, m.
    """

    place: int
    visit: int
    start_us: int
    end_us: int
    x_m: tuple[float, float]

    @property
    def encoder_mps(self) -> float:
        """Speed by the encoder, whose scale `eres rig solve --scale` finds."""
        return 1e6 * abs(self.x_m[1] - self.x_m[0]) / (self.end_us - self.start_us)


@dataclass(frozen=True, eq=False, slots=True)
class Way:
    """Which part of the print is in the middle of a crop at each position of its slider.

    Parameters
    ----------
    slider
        The readings.
    scale
        Meters of travel per meter of the encoder.
    begin_m, slope
        Position along the print at the slider's 0, m, and change with that of the slider.
    """

    slider: Slider
    scale: float
    begin_m: float
    slope: float

    @classmethod
    def of(cls, cropped: Cropped, slider: Slider, along: Float64) -> Way:
        """Return the way of a crop.

        Parameters
        ----------
        cropped
            The crop.
        slider
            Its readings.
        along
            (2,) unit vector of the travel on the page.

        Returns
        -------
        Way
            With positions along that vector.

        Raises
        ------
        RigError
            If the carriage does not move.
        """
        pose, middle_px = cropped.pose.pose(), 0.5 * np.array([[cropped.width, cropped.height]])
        ends = np.array([slider.x_m.min(), slider.x_m.max()])
        if ends[0] == ends[1]:
            raise RigError(f"slider: found the carriage at {ends[0]:g} m alone, expected motion")
        at = [on_page(pose, cropped.camera(), middle_px, x)[0] @ along for x in ends.tolist()]
        slope = (at[1] - at[0]) / (ends[1] - ends[0])
        return cls(slider, pose.scale, float(at[0] - slope * ends[0]), float(slope))

    @property
    def span_m(self) -> tuple[float, float]:
        """First and last position along the print, m."""
        ends = self.begin_m + self.slope * np.array([self.slider.x_m.min(), self.slider.x_m.max()])
        return float(ends.min()), float(ends.max())

    def slider_m(self, position_m: ArrayLike) -> Float64:
        """Return the slider's positions, m, at positions along the print, m."""
        return np.asarray((np.asarray(position_m) - self.begin_m) / self.slope)

    def windows(
        self, places_m: Float64, travel_m: float, first_us: int, last_us: int
    ) -> list[Window]:
        """Return the windows of constant speed, in the order of their starts.

        Parameters
        ----------
        places_m
            (K,) positions along the print, m.
        travel_m
            Travel in a window, m; a place is in its middle.
        first_us, last_us
            Start and end of the events.

        Returns
        -------
        windows
            One for each time that the carriage passes a place.
        """
        first_us = max(first_us, math.ceil(self.slider.t_us[0]))
        last_us = min(last_us, math.floor(self.slider.t_us[-1]))
        half_m = 0.5 * travel_m / self.scale
        found: list[Window] = []
        for place, middle_m in enumerate(self.slider_m(places_m).tolist()):
            passed: Counter[bool] = Counter()
            for start, end, rises in _passes(self.slider, middle_m - half_m, middle_m + half_m):
                start_us, end_us = round(start), round(end)
                back = rises != (self.slope > 0)
                visit = 2 * passed[back] + back
                passed[back] += 1
                if not first_us <= start_us < end_us <= last_us:
                    continue
                x = self.slider.position_m(np.linspace(start_us, end_us, _CHECKED))
                even = np.linspace(x[0], x[-1], _CHECKED)
                if np.max(np.abs(x - even)) < _EVEN * abs(x[-1] - x[0]):
                    at = float(x[0]), float(x[-1])
                    found.append(Window(place, visit, start_us, end_us, at))
        return sorted(found, key=lambda one: one.start_us)


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
