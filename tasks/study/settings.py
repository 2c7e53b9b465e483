"""What a study computes: nested frozen dataclasses, Render -> Simulate -> Evaluate."""

from __future__ import annotations

import math
import operator
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

from eres_render.storage.settings_reader import FloatOrInf
from tasks.errors import StudyError
from tasks.evaluation.settings import Evaluate
from tasks.methods import task_of

LEAST_RESOLUTION = 62
"""Side of frames, px, in which `sensor.statistics.slope_scaling` has room for its blocks."""

_MAY_BE_ZERO = {
    *("seed", "dark_fraction", "warmup_time_constants"),
    *("initial_sigma_px", "max_delay_us", "run_in_s"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Render:
    """The light.

    Parameters
    ----------
    resolution
        Side of the rendered frames, px.
    spp
        Samples per pixel.
    max_displacement_px
        Largest motion in the image from one frame to the next, px of the render.
    window_s, every_s
        Length of the scored window, and time from sample to sample, seconds of the path.
    samples
        How many of the path's samples to score, spread evenly; None for all.
    seed
        Of the renderer's sampler.
    """

    resolution: int = 1280
    spp: int = 16
    max_displacement_px: float = 0.5
    window_s: float = 0.05
    every_s: float = 0.5
    samples: int | None = None
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulate:
    """The sensors: every width with every cutoff and contrast threshold at every speed.

    Parameters
    ----------
    widths
        Sensor sides, px.
    cutoffs_hz
        Photoreceptor cutoffs; inf is ideal.
    contrast_thresholds
        C, log units.
    speeds
        Factors on the camera's base speed.
    dark_fraction
        Dark level as a fraction of the scene's white level.
    warmup_time_constants
        Time constants of the slowest filter, at the highest speed, before a window starts.
    """

    widths: tuple[int, ...] = (128, 240, 346, 640, 1280)
    cutoffs_hz: tuple[FloatOrInf, ...] = (math.inf, 200.0, 50.0)
    contrast_thresholds: tuple[float, ...] = (0.2,)
    speeds: tuple[float, ...] = (1.0, 4 / 3, 2.0)
    dark_fraction: float = 1e-3
    warmup_time_constants: float = 6.0

    @property
    def warmup_s(self) -> float:
        """Warm-up before each window, seconds of the path."""
        return self.warmup_time_constants * max(self.speeds) / (2 * math.pi * min(self.cutoffs_hz))


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A question to the simulator: which scenes, under which light, seen by which sensors.

    Raises
    ------
    StudyError
        There is no sensor, one twice, or one finer than the frames, or a number is zero or less
        that may not be.
    """

    name: str
    scenes: tuple[str, ...]
    render: Render = field(default_factory=Render)
    simulate: Simulate = field(default_factory=Simulate)
    evaluate: Evaluate = field(default_factory=Evaluate)

    def __post_init__(self) -> None:
        for section in (
            "render",
            "simulate",
            *(f"evaluate.{task.name}" for task in fields(Evaluate)),
        ):
            self._check_numbers(section)
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

    def _check_numbers(self, section: str) -> None:
        values = operator.attrgetter(section)(self)
        for name in (one.name for one in fields(values)):
            found = getattr(values, name)
            for value in found if isinstance(found, tuple) else (found,):
                if type(value) not in (int, float) or value > 0:
                    continue
                if name not in _MAY_BE_ZERO:
                    raise StudyError(f"{section}.{name}: found {value}, expected a positive number")
                if value != 0:
                    raise StudyError(f"{section}.{name}: found {value}, expected 0 or more")


def with_method(study: Study, name: str) -> Study:
    """Return a study that runs one more method, "package.module:function", on the task it is for.

    Raises
    ------
    TaskError
        It cannot be imported, or does not say what it is for.
    """
    task = task_of(name)
    section = getattr(study.evaluate, task)
    section = replace(section, methods=(*section.methods, name))
    return replace(study, evaluate=replace(study.evaluate, **{task: section}))


def to_json(study: Study) -> dict[str, Any]:
    """The resolved study as plain JSON values; inf becomes "inf"."""
    return _plain(asdict(study))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return "inf" if isinstance(value, float) and math.isinf(value) else value
