"""v2e's program on the frames of a clip, in place of exact pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence
from sensor import Events
from sensor.emulators import V2eFrame, V2ePixels
from sensor.optics import integrate
from tasks.evaluation.sensor_setting import Setting


class EmulatedPixels:
    """Pixels of one setting, which see every so many frames: the first and the last of the window,
    and those at their steps from them.
    """

    def __init__(self, setting: Setting, sequence: RadianceSequence) -> None:
        assert setting.emulation is not None, "an exact sensor has no program"
        model, emulation = setting.model, setting.emulation
        self.optics = model.height, model.width, model.fill_factor, emulation.white
        self.pixels = V2ePixels(
            contrast_threshold=model.contrast_threshold,
            contrast_threshold_off=model.off_threshold,
            cutoff_hz=model.cutoff_hz,
            version=emulation.version,
            threshold_mismatch=model.threshold_mismatch,
            leak_hz=model.leak_hz,
            shot_noise_hz=model.shot_noise_hz,
            refractory_s=model.refractory_s,
        )
        t_s = sequence.t_s
        first = max(int(np.searchsorted(t_s, setting.t_start_s, side="right")) - 1, 0)
        start, end = np.searchsorted(t_s, sequence.window_s)
        numbers = np.arange(len(t_s))
        steps = (numbers - np.where(numbers < end, start, end)) % emulation.every
        self.sees = (numbers >= first) & (steps == 0)
        self._t_s = t_s / setting.speed
        self._first_s = float(self._t_s[self.sees][0])  # the program's 0: version C forgets others
        self._previous_us = 0

    def push(self, k: int, frame: V2eFrame) -> Events:
        """Return the events after the frame that it saw before, up to frame k.

        v2e puts events on the time of the later frame. They belong to the interval before it, so
        all come 1 us earlier: those in (start, end] are then in [start, end).
        """
        events = self.pixels.push(frame, float(self._t_s[k]) - self._first_s)
        now_us = round(1e6 * float(self._t_s[k]))
        t_us = events.t_us + round(1e6 * self._first_s)
        t_us = np.clip(t_us, self._previous_us + 1, now_us) - 1
        self._previous_us = now_us
        return Events(t_us, events.x, events.y, events.p, width=events.width, height=events.height)


def seen(
    frame: NDArray[np.floating], height: int, width: int, fill_factor: float, white: float
) -> V2eFrame:
    """Return a frame as pixels of some `EmulatedPixels.optics` see it."""
    return V2eFrame.of(integrate(frame, height, width, fill_factor) * (255 / white))
