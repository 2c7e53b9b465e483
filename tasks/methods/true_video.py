"""Oracles of video: the truth itself, as the photoreceptor changes it.

They get the frames, not only the events, and bound what methods can reach with a slow sensor: two
poles at f delay slow changes by 1 / (pi f), two time constants, and blur fast ones.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor import Events
from sensor.kernels.photoreceptor import photoreceptor_step
from sensor.optics import integrate

Float64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrueLight:
    """The light of a sequence on the pixels of a sensor, in the time of the sensor's events.

    `dark_level` is added to the radiance before the logarithm. Both poles of the photoreceptor have
    `cutoff_hz`. `fill_factor` is the light-sensitive share of a pixel's area.
    """

    sequence: RadianceSequence
    dark_level: float
    cutoff_hz: float
    speed: float
    fill_factor: float = 1.0

    @property
    def t_s(self) -> Float64:
        """(T,) times of the frames, s."""
        return self.sequence.t_s / self.speed


@dataclass
class _Oracle:
    """An oracle at the resolution of one sensor, whose events it ignores."""

    width: int
    height: int
    contrast_threshold: float
    _: KW_ONLY
    light: TrueLight

    def push(self, events: Events) -> None:
        """Ignore the events."""

    def _log_light(self, k: int) -> Float64:
        """Return the true log intensity of a frame, (height, width)."""
        frame, share = self.light.sequence.frame(k), self.light.fill_factor
        return np.log(integrate(frame, self.height, self.width, share) + self.light.dark_level)


class LateTruth(_Oracle):
    """The true image, two time constants late; constructed as video methods are, with `light`."""

    def image(self, t_us: int) -> Float64:
        """Return log intensity, (height, width), linear in time between frames.

        Before the first frame, it is that frame.
        """
        cutoff_hz = self.light.cutoff_hz
        late_s = 0.0 if math.isinf(cutoff_hz) else 1 / (math.pi * cutoff_hz)
        t_s, times = 1e-6 * t_us - late_s, self.light.t_s
        after = int(np.clip(np.searchsorted(times, t_s), 1, len(times) - 1))
        start_s, end_s = times[after - 1 : after + 1]
        share = float(np.clip((t_s - start_s) / (end_s - start_s), 0, 1))
        earlier, later = (self._log_light(k) for k in (after - 1, after))
        return earlier + share * (later - earlier)


@dataclass
class FilteredTruth(_Oracle):
    """The true log light, through both poles of the photoreceptor.

    As in the sensor, the poles start settled on the first frame, and the log light is linear in
    time between frames. Constructed as video methods are, with `light`.
    """

    def __post_init__(self) -> None:
        self._frame = 0  # the latest one that the state includes
        self._input = self._first = self._second = self._log_light(0)

    def image(self, t_us: int) -> Float64:
        """Return log intensity, (height, width): the output of the second pole."""
        t_s, times = 1e-6 * t_us, self.light.t_s
        while self._frame + 1 < len(times) and times[self._frame + 1] <= t_s + 1e-9:
            self._frame += 1
            end = self._log_light(self._frame)
            dt_s = times[self._frame] - times[self._frame - 1]
            self._first, self._second = self._advanced(end, dt_s)
            self._input = end
        left_s = t_s - times[self._frame]
        if self._frame + 1 == len(times) or left_s <= 1e-9:
            return self._second
        after = self._log_light(self._frame + 1)
        share = left_s / (times[self._frame + 1] - times[self._frame])
        return self._advanced(self._input + share * (after - self._input), left_s)[1]

    def _advanced(self, end: Float64, dt_s: float) -> tuple[Float64, Float64]:
        """Return the outputs of both poles after the log light went to `end`."""
        if math.isinf(self.light.cutoff_hz):
            return end, end
        step, start = photoreceptor_step(dt_s, self.light.cutoff_hz), self._input
        first = step.e * self._first + step.v1_u0 * start + step.v1_u1 * end
        second = step.e * self._second + step.v2_v1 * self._first
        return first, second + step.v2_u0 * start + step.v2_u1 * end
