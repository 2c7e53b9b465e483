"""`fit`: estimate the electronics of a sensor from a recording."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render.progress import Progress, silent
from sensor import EventCamera, Events, plain_camera
from sensor.cameras.camera import KEYS, Kind, Source
from tasks.errors import TaskError
from tasks.fitting.check import Agreement, Check, compare, parts_of
from tasks.fitting.darkness import DARK_SHARES, Swept, sweep_dark
from tasks.fitting.response import Response, fit_response
from tasks.fitting.stillness import HOT, Noise, counts, fit_noise, neighbors_together
from tasks.footage import Footage
from tasks.numerics.estimate import Estimate
from tasks.recording.frames import RecordedFrames
from tasks.recording.levels import levels_of
from tasks.recording.motion import MotionResponse, fit_motion, lag
from tasks.recording.threshold import FittedThresholds, fit_thresholds

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
        Dark level, as a share of white: the largest value that the files of the frames can store,
        for floats the 99.9th percentile of the first frame. None to choose it by the numbers of
        events of dark and bright pixels.
    rises_us
        (S,) times at which the light steps up, on the clock of the events.
    check
        Which half of the frames or the light is held out, and compared with a simulation of the
        camera that is fitted to the other half: "first", "second" or "none".
    camera
        The rest of the camera, with the grid of the recording; None for a plain camera.

    Raises
    ------
    TaskError
        Nothing is known, frames and light are both given, motion or check comes without them,
        motion comes with steps, or a number is out of range.
    """

    still_s: tuple[float, float] | None = None
    frames: RecordedFrames | None = None
    light: Footage | None = None
    motion: bool = False
    dark_share: float | None = None
    rises_us: NDArray[np.int64] | None = None
    check: Check = "none"
    camera: EventCamera | None = None

    def __post_init__(self) -> None:
        lights = (self.frames is not None) + (self.light is not None)
        steps = self.rises_us is not None
        start_s, end_s = self.still_s or (0.0, 1.0)
        dark = 0.5 if self.dark_share is None else self.dark_share
        stretch = f"--still: found {start_s:g} to {end_s:g} s"
        is_stretch = 0 <= start_s < end_s and math.isfinite(1e6 * end_s)
        is_something = self.still_s is not None or lights or steps
        no_motion = steps or not lights
        mistakes = {
            "give --frames or --crop, not both": lights == 2,
            "nothing to fit: give --still, --frames, --crop or --steps": not is_something,
            f"{stretch}, expected a start of at least 0 and a later, finite end": not is_stretch,
            "--motion needs --frames or --crop, without --steps": self.motion and no_motion,
            "--check needs --frames or --crop": self.check != "none" and not lights,
            "--dark needs --frames or --crop": self.dark_share is not None and not lights,
            f"--dark: found {dark:g}, expected a share between 0 and 1": not 0 < dark < 1,
        }
        for message, applies in mistakes.items():
            if applies:
                raise TaskError(message)


class Fitted(NamedTuple):
    """A value of a camera.

    Parameters
    ----------
    value
        An estimate, or a given value, in the unit of the camera's field.
    unit
        The unit, in words.
    source
        How it was measured.
    kind
        Kind of the source.
    """

    value: Estimate | float | str
    unit: str
    source: str
    kind: Kind = "measured"


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Estimates from a recording; None without evidence.

    Parameters
    ----------
    noise
        From stillness.
    thresholds
        From frames or light, at their dark level.
    dark
        The dark level that the numbers of events show; None if it was given. The thresholds hold
        at its value, or, if it is only bounded, at the level of the camera.
    sweep
        The dark levels that were tried.
    response
        From steps of the light.
    motion
        From light in motion.
    agreement
        With the half that was held out.
    """

    noise: Noise | None = None
    thresholds: FittedThresholds | None = None
    dark: Estimate | None = None
    sweep: tuple[Swept, ...] = ()
    response: Response | None = None
    motion: MotionResponse | None = None
    agreement: Agreement | None = None

    def values(self, recording: str) -> Mapping[str, Fitted]:
        """Return the estimates by the keys of a camera's file.

        Parameters
        ----------
        recording
            Name of the recording, for the sources.

        Returns
        -------
        Values by key, including estimates that are only bounds.
        """
        values: dict[str, Fitted] = {}
        if self.thresholds is not None:
            source = f"{recording}: light in motion"
            level = self.thresholds.dark
            at = f"{source}, with a dark level of {100 * level:.3g} % of white"
            values["threshold"] = Fitted(self.thresholds.on, "log", at)
            values["threshold_off"] = Fitted(self.thresholds.off, "log", at)
            running = "the recording begins while the camera runs"
            values["random_start"] = Fitted(True, "", running, "given")
            given = Fitted(level, "", "eres fit --dark; the thresholds hold at this level", "given")
            by_counts = f"{source}: events of dark and of bright pixels, in proportion"
            values["dark"] = given if self.dark is None else Fitted(self.dark, "", by_counts)
        if self.response is not None:
            steps = f"{recording}: {self.response.steps} steps of the light"
            values |= _of_filter(self.response, steps, "in their light")
        if self.motion is not None:
            clock = "an offset of the frames' clock counts as latency"
            if self.motion.may_be_a_shift:
                clock = self.motion.shift_sentence()
            moving = f"{recording}: {self.motion.events} events of light in motion; {clock}"
            values |= _of_filter(self.motion, moving, "in its light")
        if self.noise is not None:
            still = f"{recording}: a still stretch, in its light"
            twice = f"{still}: twice the OFF events"
            constant = "0: the shot noise is given for the light of the recording"
            values["leak"] = Fitted(self.noise.leak_hz, "Hz", f"{still}: surplus of ON events")
            values["shot_noise"] = Fitted(self.noise.shot_noise_hz, "Hz", twice)
            values["shot_noise_exponent"] = Fitted(0.0, "", constant, "given")
            hot = f"{still}: more than {HOT:g} times the mean of the others, beyond chance"
            values["hot_pixels"] = Fitted(self.noise.hot_pixels, "", hot)
            if self.noise.hot_pixel_hz is not None:
                values["hot_pixel_rate"] = Fitted(self.noise.hot_pixel_hz, "Hz", hot)
        return values

    def camera(self, known: EventCamera, recording: str) -> EventCamera:
        """Return a camera completed by the estimates.

        Parameters
        ----------
        known
            The camera. Its values stay where there is no estimate, or only a bound.
        recording
            Name of the recording, for the sources.

        Returns
        -------
        EventCamera
            An estimated cutoff holds in the light of the recording, whose illuminance is unknown.
        """
        changes: dict[str, Any] = {}
        sources = dict(known.sources)
        for key, (value, _, source, kind) in self.values(recording).items():
            if not isinstance(value, Estimate):
                changes[KEYS[key].field] = value
                sources[key] = Source(source, kind)
                continue
            number, low, high = (float(f"{end:.6g}") for end in value)
            if not value.is_bound:
                changes[KEYS[key].field] = number
                sources[key] = Source(source, kind, (low, high))
            elif not known.states(key):
                sources[key] = Source(source, "bound", (low, high))
        if "cutoff_hz" in changes:
            changes["illuminance_lux"] = None
            sources.pop("illuminance", None)
        return replace(known, **changes, sources=sources)


def _of_filter(filter: Response | MotionResponse, source: str, light: str) -> dict[str, Fitted]:
    """Return photoreceptor, cutoff and latency; a bounded filter does not show its poles."""
    values: dict[str, Fitted] = {}
    if filter.photoreceptor is None:
        source += "; one pole fits as well as two"
    if not filter.cutoff_hz.is_bound:
        poles = filter.photoreceptor or "two_pole"
        values["photoreceptor"] = Fitted(poles, "", f"{source}; the better of one and two poles")
    values["cutoff"] = Fitted(filter.cutoff_hz, "Hz", f"{source}; {light}")
    rest = f"{source}; the delay that the poles do not explain"
    return values | {"latency": Fitted(filter.latency_s, "s", rest)}


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
        raise TaskError("the recording has no events")
    result = Found()
    if evidence.still_s is not None:
        start_us, end_us = (int(events.t_us[0]) + round(1e6 * t_s) for t_s in evidence.still_s)
        if end_us > events.t_us[-1] + 1:
            length = f"{1e-6 * int(events.t_us[-1] - events.t_us[0]):.6f} s"
            problem = f"--still: found an end of {evidence.still_s[1]:g} s"
            raise TaskError(f"{problem}, but the recording lasts only {length}")
        quiet = events.between(start_us, end_us)
        noise = fit_noise(*counts(quiet), 1e-6 * (end_us - start_us))
        result = replace(result, noise=noise)
        alike = neighbors_together(quiet, noise.hot) if len(quiet) else 0.0
        if abs(alike) > _TOGETHER:
            _log.warning(
                "--still: events of neighboring pixels are correlated (%.2f), unlike noise, as if "
                "something moved or the light flickered; the noise rates may be too high",
                alike,
            )
    if evidence.rises_us is not None:
        result = replace(result, response=fit_response(events, evidence.rises_us))
        on_progress("fitting", 1, 1)
    light = evidence.light if evidence.frames is None else evidence.frames
    if light is None:
        return result
    known = evidence.camera or plain_camera(events.width, events.height)
    part, held_out = parts_of(events, light, evidence.check)
    hot = None if result.noise is None else result.noise.hot
    share = known.dark_share if evidence.dark_share is None else evidence.dark_share
    levels, coarse = (levels_of(events, each, share, hot) for each in (part.light, part.coarse))
    ends: list[float] = []
    if evidence.dark_share is None:
        noisy = result.camera(known, "")
        dark, sweep = sweep_dark(events, part, levels, coarse, noisy, on_progress)
        result = replace(result, dark=dark, sweep=sweep)
        ends = np.clip(dark[1:], DARK_SHARES[0], DARK_SHARES[-1]).tolist()
        if not dark.is_bound:
            levels, coarse = (each.at_dark(dark.value) for each in (levels, coarse))
    motion = None
    if evidence.motion:
        motion = fit_motion(levels, coarse, part.exposure_us, part.errors)
        late = 1e6 * motion.latency_s.value, motion.pole_s, motion.poles
    else:
        late = lag(levels)
    thresholds = fit_thresholds(levels, coarse, *late)
    for end in ends:
        with suppress(TaskError):  # the events do not fit the light at the end of the interval
            other = fit_thresholds(levels.at_dark(end), coarse.at_dark(end), *late)
            on, off = _covering(thresholds.on, other.on), _covering(thresholds.off, other.off)
            thresholds = thresholds._replace(on=on, off=off)
    result = replace(result, thresholds=thresholds, motion=motion)
    if held_out is None:
        return result
    agreement = compare(events, held_out, result.camera(known, ""), on_progress)
    return replace(result, agreement=agreement)


def _covering(estimate: Estimate, other: Estimate) -> Estimate:
    """Return an estimate whose interval includes that of another."""
    low, high = min(estimate.low, other.low), max(estimate.high, other.high)
    return Estimate(estimate.value, low, high)
