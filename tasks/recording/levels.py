"""`Levels`: the light of pixels at the times of their events.

An event fires when the log intensity of its pixel is exactly at a level of the comparator. So
from one event of a pixel to any later one, it changes by exactly C_on for each brighter event minus
C_off for each darker one, whatever happens in between: the light against the numbers of events is
a line, whose slopes are the thresholds. Between the frames of a camera, the light
follows from the motion of the image.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from sensor import Events
from sensor.kernels.photoreceptor import photoreceptor_step
from tasks.errors import TaskError
from tasks.footage import Footage
from tasks.footage.interpolation import displacements_px, interpolated, steps_for
from tasks.numerics.estimate import Estimate, bootstrap, tiles_of, units
from tasks.recording.frames import RecordedFrames

Float64 = NDArray[np.float64]
Int64 = NDArray[np.int64]

_MAX_FRAMES = 200  # of the stretch with most events
_MAX_STEPS = 1000  # frames after interpolation
_MAX_PIXELS = 4096
_MAX_EVENTS = 40_000  # events whose light is used; all are counted
_BLOCK = 8  # events; over longer blocks, differences between the pixels' thresholds add up
_SATURATED = 0.98  # of the brightest light
_LEAST = 100  # events
_INSTANT_S = 1e-9  # a shorter time constant counts as none
_PASSES = 6
HUBER = 1.345  # standard deviations
_DELAYS = 21  # tried before the search
SETTLING = 0.1  # of the stretch, before which a filter depends on light before the stretch


def busiest(parts: Iterable[Events], frames: RecordedFrames) -> RecordedFrames:
    """Return the successive frames, at most 200, with most events between them.

    Parameters
    ----------
    parts
        All events.
    frames
        The frames.

    Returns
    -------
    Frames
        All within the time of the events.

    Raises
    ------
    TaskError
        Fewer than three frames are within the time of the events.
    """
    t_us = frames.middle_us
    count = np.zeros(len(t_us) - 1, np.int64)
    ends_us: list[int] = []
    for part in parts:
        count += np.histogram(part.t_us, t_us)[0]
        ends_us += part.t_us[[0, -1]].tolist() if len(part) else []
    within = np.flatnonzero((t_us >= min(ends_us, default=0)) & (t_us <= max(ends_us, default=-1)))
    if len(within) < 3:
        number = f"found {len(within)} frames within the time of the events"
        raise TaskError(f"{frames.files[0].parent}: {number}, expected at least 3")
    length = min(_MAX_FRAMES, len(within)) - 1
    until = np.concatenate([[0], np.cumsum(count[within[:-1]])])
    start = within[0] + int(np.argmax(until[length:] - until[:-length]))
    return frames.some(np.arange(start, start + length + 1))


def light_between(frames: RecordedFrames) -> Footage:
    """Return the light along the motion of the image, in steps of at most half a pixel.

    Parameters
    ----------
    frames
        Frames of a camera; each is taken at the middle of its exposure.

    Returns
    -------
    The frames with motion-compensated frames between them; only the first part if this would need
    more than 1000 frames.
    """
    steps = [*map(steps_for, displacements_px(frames.footage()))]
    fit = max(1, int(np.searchsorted(np.cumsum(steps), _MAX_STEPS, side="right")))
    return interpolated(frames.some(np.arange(fit + 1)).footage(), steps[:fit])


def every_second(light: Footage) -> Footage:
    """Return every second frame of light."""
    return replace(light, t_s=light.t_s[::2], frames=lambda: islice(light, 0, None, 2))


@dataclass(frozen=True, eq=False, slots=True)
class Levels:
    """Events whose light is known.

    Parameters
    ----------
    light_us
        (T,) float64 times of the light, microseconds.
    log_light
        (T, P) float64 log of the light of P pixels plus the dark level.
    dark
        Dark level, in units of white.
    t_us, pixel
        (N,) times of the events, and their pixels, 0 to P - 1.
    on, off
        (N,) numbers of ON and OFF events of the pixel up to and including each event.
    block
        (N,) index of the group of successive events of a pixel.
    unit
        (N,) number of the pixel's tile, or of the pixel, which a bootstrap draws.
    """

    light_us: Float64
    log_light: Float64
    dark: float
    t_us: Int64
    pixel: Int64
    on: Float64
    off: Float64
    block: Int64
    unit: Int64

    def __len__(self) -> int:
        return len(self.t_us)

    @property
    def longest_delay_us(self) -> float:
        """Longest delay that is searched for: a twentieth of the time of the light."""
        return 0.5 * self.settling_us

    @property
    def settling_us(self) -> float:
        """Least time from the start of the light to an event: twice the largest delay."""
        return SETTLING * float(self.light_us[-1] - self.light_us[0])

    def at_dark(self, dark: float) -> Levels:
        """Return these levels with another dark level, in units of white."""
        light = np.maximum(np.exp(self.log_light) - self.dark, 0.0)
        return replace(self, log_light=np.log(light + dark), dark=dark)

    def within_blocks(self, values: Float64) -> Float64:
        """Return (N,) values minus the mean of their block, which removes the unknown level."""
        return values - (np.bincount(self.block, values) / np.bincount(self.block))[self.block]

    def light_at_events(
        self, delay_us: float = 0.0, pole_s: float = 0.0, poles: int = 2
    ) -> Float64:
        """Return the log light after the photoreceptor, a delay before each event.

        Parameters
        ----------
        delay_us
            The delay, microseconds.
        pole_s
            Time constant of each pole, seconds; 0 for none.
        poles
            1 or 2.

        Returns
        -------
        (N,) log units.
        """
        u, steps_s = self.log_light, 1e-6 * np.diff(self.light_us)
        t_us = self.t_us - delay_us
        k = np.clip(np.searchsorted(self.light_us, t_us, side="right") - 1, 0, len(u) - 2)
        since_s = 1e-6 * (t_us - self.light_us[k])
        u0, u1 = u[k, self.pixel], u[k + 1, self.pixel]
        slope = (u1 - u0) / steps_s[k]
        straight = u0 + slope * since_s
        if pole_s < _INSTANT_S:
            return straight
        v1, v2 = _poles(u, steps_s, pole_s, poles)
        y, lag = since_s / pole_s, slope * pole_s
        first = v1[k, self.pixel] - u0 + lag
        if poles == 1:
            return straight - lag + first * np.exp(-y)
        second = v2[k, self.pixel] - u0 + 2 * lag
        return straight - 2 * lag + (second + first * y) * np.exp(-y)


def _poles(u: Float64, steps_s: Float64, pole_s: float, poles: int) -> tuple[Float64, Float64]:
    """Return the outputs of both poles at the times of the light, (T, P) each, settled at first."""
    v1, v2 = np.empty_like(u), np.empty_like(u if poles == 2 else u[:1])
    v1[0] = v2[0] = u[0]
    for k, dt_s in enumerate(steps_s.tolist()):
        step = photoreceptor_step(dt_s, 1 / (2 * math.pi * pole_s))
        v1[k + 1] = step.e * v1[k] + step.v1_u0 * u[k] + step.v1_u1 * u[k + 1]
        if poles == 2:
            v2[k + 1] = (
                step.e * v2[k] + step.v2_v1 * v1[k] + step.v2_u0 * u[k] + step.v2_u1 * u[k + 1]
            )
    return v1, v2


def levels_of(
    events: Events, light: Footage, dark: float, hot: NDArray[np.bool_] | None = None
) -> Levels:
    """Collect events and their light in the tiles of 8 x 8 pixels with the most events.

    Parameters
    ----------
    events
        The events.
    light
        Light on the clock of the events, at times between which the image moves by at most half a
        pixel.
    dark
        Dark level, in units of white.
    hot
        (H, W) pixels to leave out.

    Returns
    -------
    Levels
        Events within the time of the light, without a tenth at its start and a twentieth at its
        end; only every n-th block if there are more than 40,000. Events at the brightest light,
        which may be saturated, are left out.

    Raises
    ------
    TaskError
        The light has another size than the sensor, or there are too few events within its time.
    """
    if (light.width, light.height) != (events.width, events.height):
        sensor = f"the sensor has {events.width}x{events.height} px"
        raise TaskError(f"{light.path}: frames have {light.width}x{light.height} px, but {sensor}")
    light_us = light.t_offset_us + 1e6 * light.t_s
    events = events.between(math.ceil(light_us[0]), math.ceil(light_us[-1]))
    place = events.y.astype(np.int64) * events.width + events.x
    count = np.bincount(place, minlength=events.width * events.height)
    if hot is not None:
        count[hot.ravel()] = 0
    tile = tiles_of(np.arange(len(count)), events.width)
    first = np.argsort(-np.bincount(tile, count), kind="stable")[: _MAX_PIXELS // 64]
    used = np.flatnonzero((count > 1) & np.isin(tile, first))
    rows = np.stack([frame.ravel()[used] for frame in light])
    chosen = np.flatnonzero(np.isin(place, used))
    chosen = chosen[np.argsort(place[chosen], kind="stable")]  # by pixel, then time
    pixel = np.searchsorted(used, place[chosen])
    t_us, p = events.t_us[chosen], events.p[chosen]
    settling_us = SETTLING * (light_us[-1] - light_us[0])
    rank = np.arange(len(pixel)) - np.searchsorted(pixel, pixel)
    thinning = max(1, -(-len(pixel) // _MAX_EVENTS))
    settled = (t_us > light_us[0] + settling_us) & (t_us < light_us[-1] - 0.5 * settling_us)
    k = np.clip(np.searchsorted(light_us, t_us, side="right") - 1, 0, len(rows) - 2)
    bright = np.minimum(rows[k, pixel], rows[k + 1, pixel])
    settled &= bright < _SATURATED * rows.max(initial=0.0)
    used_events = settled & ((pixel + rank // _BLOCK) % thinning == 0)
    if used_events.sum() < _LEAST:
        usable = f"found {used_events.sum()} usable events during the frames"
        raise TaskError(f"{usable}, expected at least {_LEAST}; do the clocks agree?")
    group = pixel * (1 + len(pixel)) + rank // _BLOCK
    kept, of_kept = np.unique(pixel[used_events], return_inverse=True)
    return Levels(
        light_us=light_us,
        log_light=np.log(rows[:, kept].astype(np.float64) + dark),
        dark=dark,
        t_us=t_us[used_events],
        pixel=of_kept,
        on=np.cumsum(p > 0)[used_events].astype(np.float64),
        off=np.cumsum(p < 0)[used_events].astype(np.float64),
        block=np.unique(group[used_events], return_inverse=True)[1],
        unit=units(used[pixel[used_events]], events.width),
    )


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
    reach_us = levels.longest_delay_us
    tried_us = np.linspace(-reach_us, reach_us, _DELAYS)

    def unexplained(delay_us: float) -> float:
        return fit_line(levels, delay_us).unexplained

    left = list(map(unexplained, tried_us.tolist()))
    best, step_us = float(tried_us[int(np.argmin(left))]), float(tried_us[1] - tried_us[0])
    bounds = max(-reach_us, best - step_us), min(reach_us, best + step_us)
    how = {"method": "bounded", "options": {"xatol": 1.0}}
    return float(optimize.minimize_scalar(unexplained, bounds=bounds, **how).x)


class Line(NamedTuple):
    """Thresholds by robust least squares.

    Parameters
    ----------
    on, off
        Of brighter and darker events, log units.
    unexplained
        Share of the squared change of the light that they do not explain.
    sums
        (tiles, 6) sums of the normal equations.
    """

    on: float
    off: float
    unexplained: float
    sums: Float64

    def thresholds(self) -> list[Estimate]:
        """Return both thresholds with the intervals of a bootstrap over tiles.

        Raises
        ------
        TaskError
            The changes of the light do not fit the events, or do not separate ON from OFF.
        """
        both = bootstrap(self.sums, solved) if np.isfinite(self.on) else []
        if not (both and all(C.low > 0 for C in both)):
            raise misfit()
        return both


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
    """
    y = levels.within_blocks(levels.light_at_events(delay_us, pole_s, poles))
    a, b = levels.within_blocks(levels.on), -levels.within_blocks(levels.off)
    products = np.stack([a * a, a * b, b * b, a * y, b * y, y * y])
    weight = np.ones(len(y))
    for _ in range(_PASSES):
        C_on, C_off = solved((products * weight).sum(axis=1))
        if not np.isfinite(C_on):
            break
        left = np.abs(y - C_on * a - C_off * b)
        scale = max(1.4826 * float(np.median(left)), 1e-12)
        weight = np.minimum(1.0, HUBER * scale / np.maximum(left, 1e-12))
    of_units = [np.bincount(levels.unit, product) for product in weight * products]
    sums = np.stack(of_units, axis=1).astype(np.float64)
    total = sums.sum(axis=0)
    C_on, C_off = solved(total)
    unexplained = 1 - float(C_on * total[3] + C_off * total[4]) / max(float(total[5]), 1e-300)
    return Line(float(C_on), float(C_off), unexplained, sums)


def solved(total: Float64) -> Float64:
    """Solve the normal equations of `fit_line`.

    Parameters
    ----------
    total
        (6,) sums over all tiles.

    Returns
    -------
    (2,) thresholds of ON and OFF; NaN if the equations are singular.
    """
    aa, ab, bb, ay, by = total[:5]
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return np.full(2, np.nan)
    return np.array([bb * ay - ab * by, aa * by - ab * ay]) / determinant


def misfit() -> TaskError:
    """Return the error of events from which no thresholds follow."""
    return TaskError(
        "thresholds: the change of the light does not match the events; frames and events must "
        "share one clock, and the light must rise and fall"
    )
