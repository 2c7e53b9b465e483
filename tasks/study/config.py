"""What a study computes: nested frozen dataclasses, Render -> Simulate -> Evaluate, and presets."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
from dataclasses import asdict, dataclass, field
from typing import Any

from eres_render import Clip, Scene
from tasks.errors import StudyError

# Raise a stage's number when its results change, so that artefacts made before are not taken for
# its own.
STAGE_VERSIONS = {"render": 2, "simulate": 1, "evaluate": 1}


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
    """The sensors: every width with every cutoff at every speed.

    Parameters
    ----------
    widths
        Sensor sides, px.
    cutoffs_hz
        Photoreceptor cutoffs; inf is ideal.
    speeds
        Factors on the camera's base speed.
    contrast_threshold
        C, log units.
    dark_fraction
        Dark level as a fraction of the scene's white level.
    warmup_time_constants
        Time constants of the slowest filter, at the highest speed, before a window starts.
    """

    widths: tuple[int, ...] = (128, 240, 346, 640, 1280)
    cutoffs_hz: tuple[float, ...] = (math.inf, 200.0, 50.0)
    speeds: tuple[float, ...] = (1.0, 4 / 3, 2.0)
    contrast_threshold: float = 0.2
    dark_fraction: float = 1e-3
    warmup_time_constants: float = 6.0

    @property
    def warmup_s(self) -> float:
        """Warm-up before each window, seconds of the path."""
        return self.warmup_time_constants * max(self.speeds) / (2 * math.pi * min(self.cutoffs_hz))


@dataclass(frozen=True, slots=True, kw_only=True)
class Evaluate:
    """The tasks.

    Parameters
    ----------
    reconstruction
        Names of the image reconstruction methods.
    upsampling
        How event integration brings events to the frames' resolution: "nearest", "bilinear" or
        "bicubic".
    """

    reconstruction: tuple[str, ...] = ("event_integration", "no_events")
    upsampling: str = "bicubic"


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A question to the simulator: which scenes, under which light, seen by which sensors.

    Raises
    ------
    StudyError
        There is no sensor, or one finer than the frames, or a number is not positive.
    """

    name: str
    scenes: tuple[str, ...]
    render: Render = field(default_factory=Render)
    simulate: Simulate = field(default_factory=Simulate)
    evaluate: Evaluate = field(default_factory=Evaluate)

    def __post_init__(self) -> None:
        sensors = self.simulate
        for name in ("widths", "cutoffs_hz", "speeds"):
            values = getattr(sensors, name)
            if not values or not all(value > 0 for value in values):
                raise StudyError(
                    f"simulate.{name}: found {values}, expected one or more positive numbers"
                )
        if max(sensors.widths) > self.render.resolution:
            raise StudyError(
                f"simulate.widths: found {max(sensors.widths)} px, finer than render.resolution = "
                f"{self.render.resolution} px"
            )

    def clip_key(self, scene: Scene, clip: Clip) -> str:
        """Name of a clip's rows: a digest of everything that decides them."""
        return _digest(
            {
                "scene": scene.digest,
                "clip": asdict(clip),
                "render": {**asdict(self.render), "samples": None},  # other clips change nothing
                "simulate": asdict(self.simulate),
                "evaluate": asdict(self.evaluate),
                "versions": STAGE_VERSIONS,
            }
        )

    def frames_key(self, scene: Scene, clip: Clip, variant: str, mitsuba: str) -> str:
        """Name of a clip's frames: a digest of everything that decides them."""
        return _digest(
            {
                "scene": scene.digest,
                "clip": asdict(clip),
                "render": {**asdict(self.render), "samples": None},
                "variant": variant,
                "mitsuba": mitsuba,
                "version": STAGE_VERSIONS["render"],
            }
        )


PRESETS = {
    "quick": Study(
        name="quick",
        scenes=("carpet",),
        render=Render(spp=4, max_displacement_px=1.0, samples=3),
    ),
}


def preset(name: str) -> Study:
    """Return a preset study.

    Raises
    ------
    StudyError
        There is none of that name; the text gives the nearest one.
    """
    if name not in PRESETS:
        near = difflib.get_close_matches(name, PRESETS, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]!r}?" if near else f"there is {', '.join(PRESETS)}"
        raise StudyError(f"no preset named {name!r}: {hint}")
    return PRESETS[name]


def to_json(study: Study) -> dict[str, Any]:
    """The resolved study as plain JSON values; inf becomes "inf"."""
    return _plain(asdict(study))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return "inf" if isinstance(value, float) and math.isinf(value) else value


def _digest(values: dict[str, Any]) -> str:
    text = json.dumps(_plain(values), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:20]
