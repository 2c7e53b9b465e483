"""Cutoff and latency, from light in known motion."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy import optimize

from sensor.model import Photoreceptor
from tasks.errors import TaskError
from tasks.numerics.estimate import Estimate, bootstrap
from tasks.recording.levels import HUBER, Float64, Levels, best_delay_us, fit_line, misfit

# Shares of the filter in the delay, squared, from which searches start; they may end apart.
_SHARES = (0.3, 0.9)
_PIXELS = 0.05  # of a time constant: effect of thresholds that differ by 10 %, in simulations
NOISY = 0.05
"""If a larger share of the change of light is unexplained, the filter cannot be told from it, and
thresholds are underestimated."""
KNOWN, INTERPOLATED = 0.1, 0.3
# Share of what a delay leaves that a filter may owe to errors of the light: up to 0.057 in
# simulations of sensors without one, and 0.25 where the light between frames is interpolated.
_STEP_US, _STEP = 2.0, 0.01  # steps for the derivatives
_MIN_US = 1.0  # delay of a sensor that is not late
_EARLY = 0.005  # of the longest delay: events may be so early, as delays are only known so well
_AT_MOST = 0.999  # of the longest delay: a search that ends beyond would have gone on


class MotionResponse(NamedTuple):
    """How late and how smooth the events are.

    Parameters
    ----------
    photoreceptor
        "two_pole" or "one_pole"; None if both fit: then the numbers are those of two poles.
    delay_s
        Delay of slow changes: the latency and the time constants of all poles.
    cutoff_hz
        Corner frequency of each pole; its interval ends at inf if the filter cannot be told from a
        delay.
    latency_s
        The part of the delay that the poles do not explain.
    shift_us
        Shift of the light's clock that explains the delay best without a filter, microseconds.
    unexplained
        Share of the squared change of the light from event to event that the fit does not explain.
    events
        Number of events.
    """

    photoreceptor: Photoreceptor | None
    delay_s: Estimate
    cutoff_hz: Estimate
    latency_s: Estimate
    shift_us: float
    unexplained: float
    events: int

    @property
    def may_be_a_shift(self) -> bool:
        """Whether clocks that disagree explain the delay as well as a filter."""
        return self.cutoff_hz.is_bound and not self.delay_s.is_bound

    def shift_sentence(self) -> str:
        """Return a sentence on the shift that may be all of the delay."""
        return (
            f"a shift of the frames' clock by {1e-3 * self.shift_us:.2g} ms explains the delay as "
            "well as a filter"
        )

    @property
    def poles(self) -> int:
        """Number of poles for which the numbers hold."""
        return 1 if self.photoreceptor == "one_pole" else 2

    @property
    def pole_s(self) -> float:
        """Time constant of each pole, seconds."""
        return 1 / (2 * math.pi * self.cutoff_hz.value)


def fit_motion(
    levels: Levels, coarse: Levels, exposure_us: float = 0.0, errors: float = KNOWN
) -> MotionResponse:
    """Estimate cutoff and latency from events whose light is known.

    An event lags its light by the latency and the filter. Slow changes determine the sum; fast ones
    are also smoothed by the filter, but not by the latency, and separate the two. The log light at
    the events, filtered and delayed, is fitted to the numbers of events of each pixel, in units of
    the threshold, by least squares with Huber's loss. The unknowns are the delay, the share of the
    filter, and both thresholds.

    The intervals are those of a bootstrap over tiles of pixels, to first order, widened by the
    change of the answer with light from every second frame, and by 5 % of the time constant for
    thresholds that differ between pixels by up to 10 %. An exposure smooths the frames as the
    filter smooths the events, so the lower end of the cutoff includes its smoothing. A filter also
    smooths errors of the light, so its upper end includes that they are a part of what the filter
    explains. If the filter explains no more than they may, or if more than a twentieth of the
    change of the light is unexplained, the cutoff is only bounded from below, and the latency by
    the delay: light on a clock that is early explains as much.

    Parameters
    ----------
    levels
        Events with their light.
    coarse
        The same with light from every second frame.
    exposure_us
        Exposure of the frames, microseconds.
    errors
        Share of what a delay alone leaves that errors of the light may explain as a filter.

    Returns
    -------
    MotionResponse

    Raises
    ------
    TaskError
        The events are not later than the light, for example because the clocks disagree, or later
        by a twentieth of the time of the light or more.
    """
    start_us = best_delay_us(levels)
    if start_us < -_EARLY * levels.settling_us:
        raise TaskError(
            f"motion: events precede the light that causes them by {-start_us:.0f} us; do the "
            "clocks of frames and events agree?"
        )
    fits = {poles: _Fit(levels, poles, start_us) for poles in (1, 2)}
    (better,) = bootstrap((fits[1].costs - fits[2].costs)[:, None], lambda total: total)
    poles = 1 if better.high < 0 else 2
    decided = better.high < 0 or better.low > 0
    chosen, other = fits[poles], _Fit(coarse, poles, start_us)
    chosen.check("motion")
    delay, pole, latency = (
        estimate.widened(abs(theirs - estimate.value))
        for estimate, theirs in zip(chosen.estimates(), other.answer(), strict=True)
    )
    apart = _PIXELS * pole.value
    pole, latency = pole.widened(apart), latency.widened(poles * apart)
    blur = (1e-6 * exposure_us) ** 2 / (12 * poles)
    slowest = math.sqrt(pole.high**2 + blur)
    latency = latency.widened(poles * (slowest - pole.high))
    unexplained = fit_line(levels, 1e6 * latency.value, pole.value, poles).unexplained
    alone = fit_line(levels, start_us).unexplained
    # What a filter explains grows with the fourth power of its time constant.
    filtered = 1 - errors * alone / max(alone - unexplained, 1e-12)
    if unexplained > NOISY or filtered <= 0:
        pole = Estimate(pole.value, 0.0, slowest)
    else:
        fastest = min(pole.low, filtered**0.25 * pole.value)
        owed = poles * (pole.low - fastest)
        pole, latency = pole._replace(low=fastest), latency._replace(high=latency.high + owed)
        delay = delay._replace(low=delay.low - 0.5 * owed)
    if pole.low <= 0 or latency.value < 1e-6:  # at its bound, the draws do not vary
        latency = Estimate(latency.value, 0.0, max(latency.high, delay.high - poles * pole.low))
    return MotionResponse(
        photoreceptor=None if not decided else "two_pole" if poles == 2 else "one_pole",
        delay_s=delay,
        cutoff_hz=Estimate(*(_corner_hz(seconds) for seconds in (pole.value, slowest, pole.low))),
        latency_s=latency,
        shift_us=start_us,
        unexplained=unexplained,
        events=len(levels),
    )


def lag(levels: Levels) -> tuple[float, float, int]:
    """Return how the light at the events is late and smooth, for thresholds alone.

    A photoreceptor also smooths the light. Thresholds of light that is only late would be too high:
    by 9 % at 200 Hz and 24 % at 50 Hz where the image moves by up to 565 px/s.

    Parameters
    ----------
    levels
        Events with their light.

    Returns
    -------
    delay_us, pole_s, poles
        For `fit_thresholds`. Events that are not later than their light have a delay alone.

    Raises
    ------
    TaskError
        The events do not follow the light, or are later by a twentieth of its time or more.
    """
    delay_us = best_delay_us(levels)
    if delay_us < _MIN_US:
        return delay_us, 0.0, 2
    fits = {poles: _Fit(levels, poles, delay_us) for poles in (1, 2)}
    poles = min(fits, key=lambda poles: fits[poles].costs.sum())
    fits[poles].check("thresholds")
    _, pole_s, latency_s = fits[poles].answer().tolist()
    return 1e6 * latency_s, pole_s, poles


def _corner_hz(pole_s: float) -> float:
    return math.inf if pole_s <= 0 else 1 / (2 * math.pi * pole_s)


class _Fit:
    """Least squares of delay, share of the filter and thresholds.

    The share is squared, as a fast filter smooths in proportion to the square of its time constant.
    """

    def __init__(self, levels: Levels, poles: int, start_us: float) -> None:
        self._levels, self._poles = levels, poles
        self._on, self._off = (levels.within_blocks(values) for values in (levels.on, levels.off))
        most_us = levels.longest_delay_us
        start_us = min(max(start_us, _MIN_US), most_us)
        line = fit_line(levels, start_us)
        if not min(line.on, line.off) > 0:  # NaN as well
            raise misfit()
        thresholds = math.log(line.on), math.log(line.off)
        at_start = self._left(np.array([start_us, 0.0, *thresholds]))
        self._scale = HUBER * 1.4826 * float(np.median(np.abs(at_start)))
        searches = [
            optimize.least_squares(
                self._left,
                [start_us, share, *thresholds],
                self._slopes,
                bounds=([_MIN_US, 0.0, -10.0, -10.0], [most_us, 1.0, 5.0, 5.0]),
                x_scale=[0.1 * start_us, 0.3, 0.1, 0.1],
                loss="huber",
                f_scale=self._scale,
                xtol=1e-10,  # of the norm of all four, and the delay is thousands of microseconds
                ftol=1e-7,
                max_nfev=100,
            )
            for share in _SHARES
        ]
        self._x: Float64 = min(searches, key=lambda search: search.cost).x
        self._rest = self._left(self._x)

    def _left(self, x: Float64) -> Float64:
        """Return the (N,) residuals of the light at the events, in thresholds."""
        delay_us, share, C_on, C_off = x[0], x[1], math.exp(x[2]), math.exp(x[3])
        pole_s = 1e-6 * delay_us * math.sqrt(share) / self._poles
        late_us = delay_us - 1e6 * self._poles * pole_s
        light = self._levels.light_at_events(late_us, pole_s, self._poles)
        left = self._levels.within_blocks(light) - C_on * self._on + C_off * self._off
        return np.asarray(left / (0.5 * (C_on + C_off)))

    def _slopes(self, x: Float64) -> Float64:
        """Return (N, 4) derivatives of `_left`."""
        at = self._left(x)
        C_on, C_off = math.exp(x[2]), math.exp(x[3])
        share = _STEP if x[1] < 0.5 else -_STEP
        later, filtered = (x + np.array(step) for step in ((_STEP_US, 0, 0, 0), (0, share, 0, 0)))
        return np.stack(
            [
                (self._left(later) - at) / _STEP_US,
                (self._left(filtered) - at) / share,
                -C_on * (2 * self._on + at) / (C_on + C_off),
                C_off * (2 * self._off - at) / (C_on + C_off),
            ],
            axis=1,
        )

    def check(self, asked: str) -> None:
        """Refuse a delay that is as long as the search goes: the true one may be longer."""
        most_us = self._levels.longest_delay_us
        if self._x[0] > _AT_MOST * most_us:
            light_us = self._levels.light_us
            raise TaskError(
                f"{asked}: events follow the light by {1e-3 * most_us:.3g} ms or more, a twentieth "
                f"of the {1e-3 * float(light_us[-1] - light_us[0]):.4g} ms that the frames last; "
                "give a longer stretch of frames"
            )

    @property
    def costs(self) -> Float64:
        """(tiles,) Huber's loss."""
        r = np.abs(self._rest)
        loss = np.where(r <= self._scale, 0.5 * r * r, self._scale * (r - 0.5 * self._scale))
        return np.bincount(self._levels.unit, loss).astype(np.float64)

    def answer(self, step: Float64 | None = None) -> Float64:
        """Return delay, time constant and latency, seconds, at the fit or a step from it."""
        delay_us, share = self._x[:2] if step is None else self._x[:2] + step[:2]
        delay_s, filtered = 1e-6 * max(0.0, delay_us), math.sqrt(min(max(share, 0.0), 1.0))
        filtered = 1.0 if filtered > 1 - 1e-6 else filtered
        return np.array([delay_s, delay_s * filtered / self._poles, delay_s * (1 - filtered)])

    def estimates(self) -> list[Estimate]:
        """Return the answer with intervals; each draw takes one Gauss-Newton step.

        Draws vary around the shortest delay, and an answer at it may be outside of most.
        """
        weight = np.minimum(1.0, self._scale / np.maximum(np.abs(self._rest), 1e-12))
        J = self._slopes(self._x)
        upper = np.triu_indices(4)
        columns = [weight * J[:, i] * J[:, j] for i, j in zip(*upper, strict=True)]
        columns += [weight * J[:, i] * self._rest for i in range(4)]
        of_units = [np.bincount(self._levels.unit, column) for column in columns]
        sums = np.stack(of_units, axis=1).astype(np.float64)

        def answer(total: Float64) -> Float64:
            H = np.zeros((4, 4))
            H[upper] = total[:10]
            H = H + np.triu(H, 1).T
            g = total[10:]
            step = -np.linalg.lstsq(H, g, rcond=None)[0]
            share = self._x[1] + step[1]
            if not 0 <= share <= 1:  # the best at the bound
                at = min(max(share, 0.0), 1.0) - self._x[1]
                others = [0, 2, 3]
                rest = np.linalg.lstsq(
                    H[np.ix_(others, others)], g[others] + H[others, 1] * at, rcond=None
                )[0]
                step = np.array([-rest[0], at, -rest[1], -rest[2]])
            return self.answer(step.astype(np.float64))

        return [
            Estimate(float(value), min(drawn.low, value), max(drawn.high, value))
            for value, drawn in zip(self.answer(), bootstrap(sums, answer), strict=True)
        ]
