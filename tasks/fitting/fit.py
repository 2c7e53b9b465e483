"""`fit`: estimate the electronics of a sensor from a recording."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import Events
from tasks.errors import TaskError
from tasks.fitting.profile_file import Measured
from tasks.fitting.response import Response, fit_response
from tasks.fitting.stillness import HOT, Noise, counts, fit_noise, neighbors_together
from tasks.footage import Footage
from tasks.recording.frames import Frames
from tasks.recording.levels import busiest, every_second, levels_of, light_between
from tasks.recording.motion import MotionResponse, fit_motion, lag
from tasks.recording.threshold import FittedThresholds, fit_thresholds

USUAL_DARK = 1e-3
DARK_SHARES = (3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1)
"""Dark levels of the sweep, shares of white."""

_log = logging.getLogger(__name__)

_TOGETHER = 0.1  # correlation of neighbors above which a stretch is not still


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What is known about a recording.

    Parameters
    ----------
    still_s
        (2,) start and end of a stretch without motion, seconds after the first event.
    frames
        Frames of the same camera, on the clock of the events.
    light
        In place of frames: light with white at 1, at times between which the image moves by half a
        pixel at most.
    motion
        Whether to estimate cutoff and latency from the motion of the frames or the light.
    dark_share
        Dark level for thresholds and motion, as a share of white: the largest value that the files
        of the frames can store, for floats the 99.9th percentile of the first frame.
    rises_us
        (S,) times at which the light steps up, on the clock of the events.

    Raises
    ------
    TaskError
        Nothing is known, frames and light are both given, motion comes without them or with steps,
        or a number is out of range.
    """

    still_s: tuple[float, float] | None = None
    frames: Frames | None = None
    light: Footage | None = None
    motion: bool = False
    dark_share: float = USUAL_DARK
    rises_us: NDArray[np.int64] | None = None

    def __post_init__(self) -> None:
        if self.frames is not None and self.light is not None:
            raise TaskError("frames, crop: found both, expected one of them")
        seen = self.frames is not None or self.light is not None
        if self.still_s is None and not seen and self.rises_us is None:
            raise TaskError(
                "found neither still, frames, crop nor steps, expected one or more of them: what "
                "to fit"
            )
        if self.still_s is not None:
            start_s, end_s = self.still_s
            if not (0 <= start_s < end_s and math.isfinite(1e6 * end_s)):
                raise TaskError(
                    f"still: found {start_s:g} to {end_s:g} s, expected a start of at least 0 and "
                    "a later, finite end"
                )
        if self.motion and (not seen or self.rises_us is not None):
            raise TaskError("motion: expected it with frames or a crop, and without steps")
        if not 0 < self.dark_share < 1:
            raise TaskError(f"dark: found {self.dark_share:g}, expected a share of white in (0, 1)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Estimates from a recording; None without evidence.

    Parameters
    ----------
    noise
        From stillness.
    thresholds
        From frames, at the dark level of the evidence.
    sweep
        The same at other dark levels.
    response
        From steps of the light.
    motion
        From light in motion.
    """

    noise: Noise | None = None
    thresholds: FittedThresholds | None = None
    sweep: tuple[FittedThresholds, ...] = ()
    response: Response | None = None
    motion: MotionResponse | None = None

    def sentence(self) -> str:
        """Return a sentence on how far the thresholds depend on the dark level."""
        if not self.sweep:
            return "no other dark level fits, so how far the answer depends on it is not known"
        on, off = ([getattr(one, sign).value for one in self.sweep] for sign in ("on", "off"))
        low, high = (100 * end(one.dark for one in self.sweep) for end in (min, max))
        return (
            f"the answer depends on the dark level: from {low:g} to {high:g} % of white, ON is "
            f"{min(on):.2g} to {max(on):.2g} and OFF {min(off):.2g} to {max(off):.2g}"
        )

    def fields(self, recording: str) -> Mapping[str, Measured]:
        """Return the fields of a profile.

        Parameters
        ----------
        recording
            Name of the recording, for the sources.

        Returns
        -------
        Measured values by the name of the field.
        """
        fields: dict[str, Measured] = {}
        if self.response is not None:
            source = f"{recording}: {self.response.steps} steps of the light"
            fields |= _of_filter(self.response, source, "in their light")
        if self.motion is not None:
            source = f"{recording}: {self.motion.events} events of light in motion"
            clock = "an offset of the frames' clock counts as latency"
            if self.motion.may_be_a_shift:
                clock = self.motion.shift_sentence()
            fields |= _of_filter(self.motion, f"{source}; {clock}", "in its light")
        if self.thresholds is not None:
            share = 100 * self.thresholds.dark
            source = f"{recording}: light in motion, with a dark level of {share:g} % of white; "
            source += self.sentence()
            fields["threshold_on"] = Measured(self.thresholds.on, "log", source)
            fields["threshold_off"] = Measured(self.thresholds.off, "log", source)
        if self.noise is not None:
            source = f"{recording}: a still stretch, in its light"
            fields["leak"] = Measured(self.noise.leak_hz, "Hz", f"{source}: surplus of ON events")
            fields["shot_noise"] = Measured(
                self.noise.shot_noise_hz, "Hz", f"{source}: twice the OFF events"
            )
            fields["shot_noise_exponent"] = Measured(
                0.0, "1", "0, as the shot noise is that of the light of the recording"
            )
            hot = f"{source}: more than {HOT:g} times the mean of the others, beyond chance"
            fields["hot_pixels"] = Measured(self.noise.hot_pixels, "1", hot)
            if self.noise.hot_pixel_hz is not None:
                fields["hot_pixel_rate"] = Measured(self.noise.hot_pixel_hz, "Hz", hot)
        return fields


def _of_filter(found: Response | MotionResponse, source: str, light: str) -> Mapping[str, Measured]:
    """Return photoreceptor, cutoff and latency; a bounded filter does not show its poles."""
    fields: dict[str, Measured] = {}
    if found.photoreceptor is None:
        source += "; one pole fits as well as two"
    elif not found.cutoff_hz.is_bound:
        fields["photoreceptor"] = Measured(
            found.photoreceptor, "", f"{source}; the better of one and two poles"
        )
    fields["cutoff"] = Measured(found.cutoff_hz, "Hz", f"{source}; {light}")
    fields["latency"] = Measured(
        found.latency_s, "s", f"{source}; the delay that the poles do not explain"
    )
    return fields


def fit(events: Events, evidence: Evidence, on_progress: Progress = silent) -> Found:
    """Estimate the electronics of a sensor from a recording.

    Parameters
    ----------
    events
        The recording.
    evidence
        What is known about it.
    on_progress
        Called after each step.

    Returns
    -------
    Found

    Raises
    ------
    TaskError
        The recording is empty, or does not show enough.
    """
    if len(events) == 0:
        raise TaskError("found a recording without events")
    noise = None
    if evidence.still_s is not None:
        start_us, end_us = (int(events.t_us[0]) + round(1e6 * one) for one in evidence.still_s)
        if end_us > events.t_us[-1] + 1:
            seconds = 1e-6 * int(events.t_us[-1] - events.t_us[0])
            raise TaskError(
                f"still: found an end of {evidence.still_s[1]:g} s, expected at most "
                f"{seconds:.6f} s, the length of the recording"
            )
        quiet = events.between(start_us, end_us)
        noise = fit_noise(*counts(quiet), 1e-6 * (end_us - start_us))
        alike = neighbors_together(quiet, noise.hot) if len(quiet) else 0.0
        if abs(alike) > _TOGETHER:
            _log.warning(
                "still: events of neighboring pixels are correlated (%.2f), as if something moved "
                "or the light flickered; noise is independent, so its rates come out too high",
                alike,
            )
    found = Found(noise=noise)
    if evidence.frames is not None or evidence.light is not None:
        found = _in_motion(events, evidence, found, on_progress)
    if evidence.rises_us is not None:
        found = replace(found, response=fit_response(events, evidence.rises_us))
        on_progress("fitting", 1, 1)
    return found


def _in_motion(events: Events, evidence: Evidence, found: Found, on_progress: Progress) -> Found:
    """Add the thresholds and, on request, cutoff and latency from motion."""
    exposure_us = 0.0
    if evidence.frames is not None:
        frames = busiest([events], evidence.frames)
        lights = [light_between(one) for one in (frames, frames.every_second())]
        exposure_us = float(np.max(frames.end_us - frames.start_us))
    else:
        assert evidence.light is not None
        lights = [evidence.light, every_second(evidence.light)]
    hot = None if found.noise is None else found.noise.hot
    most = len(DARK_SHARES) + 3
    pair = []
    for k, light in enumerate(lights, start=1):
        pair.append(levels_of(events, light, evidence.dark_share, hot))
        on_progress("following the light", k, most)
    levels, coarse = pair
    motion = None
    if evidence.motion:
        motion = fit_motion(levels, coarse, exposure_us)
        late = 1e6 * motion.latency_s.value, motion.pole_s, motion.poles
    else:
        late = lag(levels)
    on_progress("fitting", 3, most)
    thresholds = fit_thresholds(levels, coarse, *late)
    sweep = []
    for k, share in enumerate(DARK_SHARES, start=4):
        with suppress(TaskError):  # nobody asked for this level; the others are printed
            sweep.append(fit_thresholds(levels.at_dark(share), coarse.at_dark(share), *late))
        on_progress("fitting", k, most)
    return replace(found, thresholds=thresholds, sweep=tuple(sweep), motion=motion)
