"""Settings of a study: nested frozen dataclasses, Render -> Simulate -> Evaluate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from eres_render.storage.settings_reader import FloatOrInf
from sensor.model import Photoreceptor
from tasks.errors import StudyError, WeightsError
from tasks.evaluation.settings import MAY_BE_ZERO, Evaluate, NetworkSettings
from tasks.methods import task_of
from tasks.registry import TASKS

# Fields that the stored study has only where they are given.
_LEFT_OUT_AT_NONE = (*("weights", "other_equalizations", "e2vid_window_s", "e2vid_events_per_px"),)

LEAST_RESOLUTION = 62
"""Side of frames, px, in which `sensor.statistics.slopes_by_pixel_size` has room for its blocks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Render:
    """How the scenes are rendered.

    Parameters
    ----------
    resolution
        Side of the rendered frames, px.
    spp
        Samples per pixel.
    max_displacement_px
        Largest image motion from one frame to the next, px of the rendered frames.
    window_s, every_s
        Length of the scored window, and time between samples, seconds of the path.
    samples
        Number of samples to score, spread evenly over the path; None for all.
    seed
        Seed of the renderer's sampler.
    """

    resolution: int = 1280
    spp: int = 16
    max_displacement_px: float = 0.5
    window_s: float = 0.05
    every_s: float = 0.5
    samples: int | None = None
    seed: int = field(default=0, metadata=MAY_BE_ZERO)


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulate:
    """The sensors: each width with each cutoff and contrast threshold, at each speed.

    Parameters
    ----------
    widths
        Sensor sides, px.
    cutoffs_hz
        Photoreceptor cutoffs; inf is an ideal photoreceptor.
    contrast_thresholds
        Contrast thresholds C of Eq. (1), log units.
    speeds
        Factors on the base speed of the camera.
    dark_fraction
        Dark level as a fraction of the scene's white level.
    warmup_time_constants
        Warm-up before a window, in time constants of the slowest filter at the highest speed.
    photoreceptor
        "two_pole", "one_pole" or "v2e", see `sensor.SensorModel`; None is "two_pole".
    """

    widths: tuple[int, ...] = (128, 240, 346, 640, 1280)
    cutoffs_hz: tuple[FloatOrInf, ...] = (math.inf, 200.0, 50.0)
    contrast_thresholds: tuple[float, ...] = (0.2,)
    speeds: tuple[float, ...] = (1.0, 4 / 3, 2.0)
    dark_fraction: float = field(default=1e-3, metadata=MAY_BE_ZERO)
    warmup_time_constants: float = field(default=6.0, metadata=MAY_BE_ZERO)
    photoreceptor: Photoreceptor | None = None

    @property
    def warmup_s(self) -> float:
        """Warm-up before each window, seconds of the path."""
        return self.warmup_time_constants * max(self.speeds) / (2 * math.pi * min(self.cutoffs_hz))


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A study: which scenes, under which light, seen by which sensors, for which tasks.

    Raises
    ------
    StudyError
        If a list of sensor settings is empty or holds a value twice, a sensor is finer than the
        frames, or a number is not in its range.
    """

    name: str
    scenes: tuple[str, ...]
    render: Render = field(default_factory=Render)
    simulate: Simulate = field(default_factory=Simulate)
    evaluate: Evaluate = field(default_factory=Evaluate)

    def __post_init__(self) -> None:
        _check_numbers("render", self.render)
        _check_numbers("simulate", self.simulate)
        for task, settings in self.evaluate.items():
            _check_numbers(f"evaluate.{task}", settings)
        sensors = self.simulate
        for name in ("widths", "cutoffs_hz", "contrast_thresholds", "speeds"):
            values = getattr(sensors, name)
            if not values:
                raise StudyError(f"simulate.{name}: found none, expected one or more")
            if len(set(values)) < len(values):
                raise StudyError(f"simulate.{name}: found {values}, expected each of them once")
        if self.render.resolution < LEAST_RESOLUTION:
            raise StudyError(
                f"render.resolution: found {self.render.resolution} px, expected at least "
                f"{LEAST_RESOLUTION}, which the scaling statistics need"
            )
        if max(sensors.widths) > self.render.resolution:
            raise StudyError(
                f"simulate.widths: found {max(sensors.widths)} px, finer than render.resolution = "
                f"{self.render.resolution} px"
            )


def _check_numbers(section: str, values: Any) -> None:
    for one in fields(values):
        found, place = getattr(values, one.name), f"{section}.{one.name}"
        for value in found if isinstance(found, tuple) else (found,):
            if type(value) not in (int, float) or value > 0:
                continue
            if not MAY_BE_ZERO.items() <= one.metadata.items():
                raise StudyError(f"{place}: found {value}, expected a positive number")
            if value != 0:
                raise StudyError(f"{place}: found {value}, expected 0 or more")


def with_method(study: Study, name: str) -> Study:
    """Return a study with one more method.

    Parameters
    ----------
    study
        The study.
    name
        The method: one of the registry's that is in a single task, or "package.module:function",
        whose annotations tell which task it solves.

    Returns
    -------
    The study with the method added to its task.

    Raises
    ------
    TaskError
        If the method cannot be imported, or its task is unclear.
    """
    task = task_of(name)
    section = study.evaluate[task]
    section = replace(section, methods=tuple(dict.fromkeys((*section.methods, name))))
    return replace(study, evaluate=Evaluate(**{**study.evaluate, task: section}))


def with_weights(study: Study, weights: Mapping[str, str]) -> Study:
    """Return a study with files of weights.

    Parameters
    ----------
    study
        The study.
    weights
        Files by the names of methods with a network.

    Returns
    -------
    The study with the weights in the settings of the tasks that have these methods.

    Raises
    ------
    WeightsError
        The study does not use one of the methods.
    """
    used = set()
    sections = dict(study.evaluate)
    for task, section in sections.items():
        own = {name: weights[name] for name in TASKS[task].networks if name in weights}
        used |= own.keys() & {*section.methods}
        if own:
            if not isinstance(section, NetworkSettings):
                raise TypeError(f"{task}: found {type(section)}, expected NetworkSettings")
            sections[task] = replace(section, weights={**(section.weights or {}), **own})
    for name in weights:
        if name not in used:
            raise WeightsError(
                f"weights: found some of {name}, which is not in the study's methods"
            )
    return replace(study, evaluate=Evaluate(**sections))


def to_json(study: Study) -> dict[str, Any]:
    """Return the study as plain JSON values; inf becomes "inf"."""
    return _plain(study)


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        named = {one.name: _plain(getattr(value, one.name)) for one in fields(value)}
        return {k: v for k, v in named.items() if k not in _LEFT_OUT_AT_NONE or v is not None}
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return "inf" if isinstance(value, float) and math.isinf(value) else value
