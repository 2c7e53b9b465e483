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
from sensor import Events
from sensor.cameras import EventCamera, Source, plain_camera
from sensor.cameras.camera import Kind
from sensor.cameras.fields import FIELDS
from tasks.errors import TaskError
from tasks.fitting.check import Agreement, compare
from tasks.fitting.darkness import DARK_SHARES, Swept, sweep_dark
from tasks.fitting.parts import Check, parts_of
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
        What else is known of the camera, with the grid of the recording; None for nothing.

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
        if self.frames is not None and self.light is not None:
            raise TaskError("frames, crop: found both, expected one of them")
        seen = self.frames is not None or self.light is not None
        if self.still_s is None and not seen and self.rises_us is None:
            raise TaskError("nothing to fit: give --still, --frames, --crop or --steps")
        if self.still_s is not None:
            start_s, end_s = self.still_s
            if not (0 <= start_s < end_s and math.isfinite(1e6 * end_s)):
                raise TaskError(
                    f"still: found {start_s:g} to {end_s:g} s, expected a start of at least 0 and "
                    "a later, finite end"
                )
        if self.motion and (not seen or self.rises_us is not None):
            raise TaskError("motion: expected it with frames or a crop, and without steps")
        if self.check != "none" and not seen:
            raise TaskError(f"check: found {self.check}, expected it only with --frames or --crop")
        if self.dark_share is not None and not seen:
            raise TaskError(
                f"dark: found {self.dark_share:g}, expected it only with --frames or --crop"
            )
        if self.dark_share is not None and not 0 < self.dark_share < 1:
            raise TaskError(f"dark: found {self.dark_share:g}, expected a share of white in (0, 1)")


class Fitted(NamedTuple):
    """A value of a camera.

    Parameters
    ----------
    value
        An estimate, or what was not estimated, in the unit of the camera's field.
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
        """Return what was found, by the keys of a camera's file.

        Parameters
        ----------
        recording
            Name of the recording, for the sources.

        Returns
        -------
        Values by key; an estimate that is only a bound is among them.
        """
        values: dict[str, Fitted] = {}
        if self.thresholds is not None:
            source = f"{recording}: light in motion"
            at = f"{source}, with a dark level of {100 * self.thresholds.dark:.3g} % of white"
            values["threshold"] = Fitted(self.thresholds.on, "log", at)
            values["threshold_off"] = Fitted(self.thresholds.off, "log", at)
            running = "the recording begins while the camera runs"
            values["random_start"] = Fitted(True, "", running, "given")
            if self.dark is None:
                given = "eres fit --dark; the thresholds hold at this level"
                values["dark"] = Fitted(self.thresholds.dark, "", given, "given")
            else:
                by_counts = f"{source}: events of dark and of bright pixels, in proportion"
                values["dark"] = Fitted(self.dark, "", by_counts)
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
            values["leak"] = Fitted(self.noise.leak_hz, "Hz", f"{still}: surplus of ON events")
            values["shot_noise"] = Fitted(
                self.noise.shot_noise_hz, "Hz", f"{still}: twice the OFF events"
            )
            values["shot_noise_exponent"] = Fitted(
                0.0, "", "0, as the shot noise is that of the light of the recording", "given"
            )
            hot = f"{still}: more than {HOT:g} times the mean of the others, beyond chance"
            values["hot_pixels"] = Fitted(self.noise.hot_pixels, "", hot)
            if self.noise.hot_pixel_hz is not None:
                values["hot_pixel_rate"] = Fitted(self.noise.hot_pixel_hz, "Hz", hot)
        return values

    def camera(self, known: EventCamera, recording: str) -> EventCamera:
        """Return a camera completed by what was found.

        Parameters
        ----------
        known
            The camera. Its values stay where nothing was found, or only a bound.
        recording
            Name of the recording, for the sources.

        Returns
        -------
        EventCamera
            A cutoff that was found holds in the light of the recording, whose illuminance is
            unknown.
        """
        changes: dict[str, Any] = {}
        sources = dict(known.sources)
        for key, (value, _, source, kind) in self.values(recording).items():
            if not isinstance(value, Estimate):
                changes[FIELDS[key]] = value
                sources[key] = Source(source, kind)
                continue
            number, low, high = (float(f"{one:.6g}") for one in value)
            if not value.is_bound:
                changes[FIELDS[key]] = number
                sources[key] = Source(source, kind, (low, high))
            elif not known.states(key):
                sources[key] = Source(source, "bound", (low, high))
        if "cutoff_hz" in changes:
            changes["illuminance_lux"] = None
            sources.pop("illuminance", None)
        return replace(known, **changes, sources=sources)


def _of_filter(found: Response | MotionResponse, source: str, light: str) -> Mapping[str, Fitted]:
    """Return photoreceptor, cutoff and latency; a bounded filter does not show its poles."""
    values: dict[str, Fitted] = {}
    if found.photoreceptor is None:
        source += "; one pole fits as well as two"
    if not found.cutoff_hz.is_bound:
        poles = found.photoreceptor or "two_pole"
        values["photoreceptor"] = Fitted(poles, "", f"{source}; the better of one and two poles")
    values["cutoff"] = Fitted(found.cutoff_hz, "Hz", f"{source}; {light}")
    values["latency"] = Fitted(
        found.latency_s, "s", f"{source}; the delay that the poles do not explain"
    )
    return values


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
    if evidence.rises_us is not None:
        found = replace(found, response=fit_response(events, evidence.rises_us))
        on_progress("fitting", 1, 1)
    seen = evidence.light if evidence.frames is None else evidence.frames
    return found if seen is None else _in_motion(events, seen, evidence, found, on_progress)


def _in_motion(
    events: Events,
    seen: RecordedFrames | Footage,
    evidence: Evidence,
    found: Found,
    on_progress: Progress,
) -> Found:
    """Add dark level, thresholds and, on request, cutoff and latency from motion; check them."""
    known = evidence.camera or plain_camera(events.width, events.height)
    part, held_out = parts_of(events, seen, evidence.check)
    hot = None if found.noise is None else found.noise.hot
    share = known.dark_share if evidence.dark_share is None else evidence.dark_share
    levels, coarse = (levels_of(events, light, share, hot) for light in (part.light, part.coarse))
    dark: Estimate | None = None
    sweep: tuple[Swept, ...] = ()
    ends: list[float] = []
    if evidence.dark_share is None:
        noisy = found.camera(known, "")
        dark, sweep = sweep_dark(events, part, levels, coarse, noisy, on_progress)
        ends = np.clip(dark[1:], DARK_SHARES[0], DARK_SHARES[-1]).tolist()
        if not dark.is_bound:
            levels, coarse = (one.at_dark(dark.value) for one in (levels, coarse))
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
            thresholds = thresholds._replace(
                on=_covering(thresholds.on, other.on), off=_covering(thresholds.off, other.off)
            )
    found = replace(found, thresholds=thresholds, dark=dark, sweep=sweep, motion=motion)
    if held_out is None:
        return found
    agreement = compare(events, held_out, found.camera(known, ""), on_progress)
    return replace(found, agreement=agreement)


def _covering(one: Estimate, other: Estimate) -> Estimate:
    """Return an estimate whose interval includes that of another."""
    return Estimate(one.value, min(one.low, other.low), max(one.high, other.high))
