"""Settings of a study: nested frozen dataclasses, Render -> Simulate -> Evaluate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.json_values import json_values, use_python_numbers
from eres_render.storage.settings_reader import FloatOrInf
from sensor.cameras import EventCamera
from sensor.cameras.camera import BUS_KEYS
from sensor.levels import DARK_FRACTION
from sensor.model import Photoreceptor, SensorModel
from sensor.optics import crop_to_aspect
from tasks.errors import StudyError
from tasks.evaluation.settings import MAY_BE_ZERO, Evaluate
from tasks.study import rules
from tasks.study.sensors import StudyLight, bus_of, light_at, own_of, with_area_exponents
from tasks.warm_up import TIME_CONSTANTS, needed_s

if TYPE_CHECKING:
    from sensor import Readout

# Fields that study.json has only if they are given.
_LEFT_OUT_IF_NOT_GIVEN = (
    *("question", "weights", "other_equalizations", "e2vid_window_s", "e2vid_events_per_px"),
    *("height", "same_lens", "tracking_window_s"),
    *(
        "sensors",
        "area_exponents",
        "illuminance_lux",
        "speeds_m_s",
        "distance_m",
        "bus_mev_s",
        "trajectories",
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Render:
    """How the scenes are rendered.

    Parameters
    ----------
    resolution
        Width of the rendered frames, px.
    height
        Their height, px; None for square frames. Sensors have the same aspect ratio, to a pixel.
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
    height: int | None = None

    def __post_init__(self) -> None:
        use_python_numbers(self)

    def height_at(self, width: int) -> int:
        """Return the height of a sensor of this width, px."""
        return round(width * (self.height or self.resolution) / self.resolution)

    def seen_px(self, width: int, height: int) -> tuple[int, int]:
        """Return the size of the part of the frames that a sensor sees.

        A sensor whose height is that of its width in their shape, rounded, sees all of them.

        Parameters
        ----------
        width, height
            Size of the sensor, px.

        Returns
        -------
        width, height
            Of the part, px.
        """
        frame_height = self.height_at(self.resolution)
        if height == self.height_at(width):  # rounded, and its pixels may not be quite square
            return self.resolution, frame_height
        rows, columns = crop_to_aspect(frame_height, self.resolution, height, width)
        return columns.stop - columns.start, rows.stop - rows.start


_ANY = Render()  # for what depends on no height of plain sensors


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulate:
    """The sensors: each of them in each light at each speed.

    Parameters
    ----------
    widths
        Widths of sensors with the frames' aspect ratio, px.
    cutoffs_hz
        Photoreceptor cutoffs, Hz; inf is an ideal photoreceptor.
    contrast_thresholds
        Contrast thresholds C of Eq. (1), log units.
    speeds
        Factors on the base speed of the camera.
    dark_fraction
        Dark level as a fraction of the scene's white level.
    warm_up_s
        Warm-up before a window at least, seconds of the path.
    warmup_time_constants
        Warm-up before a window at least, in time constants of a sensor's own filter at its speed.
    photoreceptors
        Each is "two_pole", "one_pole" or "v2e" (v2e's limit for small steps), see
        `sensor.SensorModel`. "two_pole" becomes the first, which the report shows in full.
    sensors
        Cameras, each with a name, in addition to the widths. What they state goes before
        `contrast_thresholds`, `photoreceptors`, `dark_fraction`, `warmup_time_constants` and
        `bus_mev_s`.
    area_exponents
        Exponents of the photodiode's area for cameras whose cutoff is lent: each of them is one
        more sensor. None for the cameras' own.
    illuminance_lux
        Illuminance of the scene, lux, in place of `cutoffs_hz`, which follow from it.
    speeds_m_s
        Mean speeds of the camera, m/s, in place of `speeds`, which follow from them for each scene.
    distance_m
        With `speeds_m_s`: median distance of the camera from the plane along its axis, m. Scene and
        path are enlarged to it, so that images stay. None for the scenes' own distance.
    bus_mev_s
        Capacity of the bus of all sensors without one of their own, million events per second; None
        for no bus. A sensor's own number of events can wait for it.
    same_lens
        Whether all widths are one camera at several distances from a plane that it faces: half the
        width is twice the distance. Images are the same as with larger pixels; poses are not. None
        means no.

    Raises
    ------
    StudyError
        If `illuminance_lux` and `cutoffs_hz` are both given and contradict each other.
    """

    widths: tuple[int, ...] = (128, 240, 346, 640, 1280)
    cutoffs_hz: tuple[FloatOrInf, ...] = (math.inf, 200.0, 50.0)
    contrast_thresholds: tuple[float, ...] = (0.2,)
    speeds: tuple[float, ...] = (1.0, 4 / 3, 2.0)
    dark_fraction: float = field(default=DARK_FRACTION, metadata=MAY_BE_ZERO)
    warmup_time_constants: float = field(default=TIME_CONSTANTS, metadata=MAY_BE_ZERO)
    photoreceptors: tuple[Photoreceptor, ...] = ("two_pole",)
    sensors: tuple[EventCamera, ...] = ()
    area_exponents: tuple[float, ...] | None = field(default=None, metadata=MAY_BE_ZERO)
    illuminance_lux: tuple[FloatOrInf, ...] | None = None
    speeds_m_s: tuple[float, ...] | None = None
    distance_m: float | None = None
    bus_mev_s: float | None = None
    same_lens: bool | None = None
    warm_up_s: float = field(default=WARM_UP_S, metadata=MAY_BE_ZERO)

    def __post_init__(self) -> None:
        use_python_numbers(self)
        readings = sorted(self.photoreceptors, key=lambda name: name != "two_pole")
        object.__setattr__(self, "photoreceptors", tuple(readings))
        if min(self.illuminance_lux or (0.0,)) <= 0:  # not given, or for `Study` to refuse
            return
        cutoffs_hz = tuple(light.cutoff_hz for light in self.lights)
        usual = {one.name: one.default for one in fields(self)}["cutoffs_hz"]
        if self.cutoffs_hz not in (cutoffs_hz, usual):
            raise StudyError(
                f"found both cutoffs_hz = {self.cutoffs_hz} and illuminance_lux, expected one of "
                "them"
            )
        object.__setattr__(self, "cutoffs_hz", cutoffs_hz)

    @property
    def lights(self) -> tuple[StudyLight, ...]:
        """The lights on the scene."""
        if self.illuminance_lux is None:
            return tuple(map(StudyLight, self.cutoffs_hz))
        return tuple(map(light_at, self.illuminance_lux))

    @property
    def cameras(self) -> tuple[EventCamera, ...]:
        """The named cameras, one for each exponent of the area."""
        if self.area_exponents is None:
            return self.sensors
        return with_area_exponents(self.sensors, self.area_exponents)

    def readout(self, camera: EventCamera) -> Readout | None:
        """Return the bus of a camera; None for no bus."""
        return bus_of(camera, self.bus_mev_s)

    def all_cameras(self, render: Render = _ANY) -> list[EventCamera]:
        """Return the plain and the named cameras, for frames of these settings."""
        plain = EventCamera(dark_share=self.dark_fraction, warm_up=self.warmup_time_constants)
        return [
            *(plain.on(width, render.height_at(width)) for width in self.widths),
            *(
                replace(
                    one,
                    dark_share=one.dark_share if one.states("dark") else plain.dark_share,
                    warm_up=one.warm_up if one.states("warm_up") else plain.warm_up,
                )
                for one in self.cameras
            ),
        ]

    @property
    def assumes(self) -> list[str]:
        """In words what the study assumes of its cameras, a line each."""
        light: dict[str, Any] = {"lux": self.illuminance_lux}
        if self.illuminance_lux is None:
            light = {"cutoff_hz": self.cutoffs_hz}
        lines: dict[str, None] = {}
        for one in self.all_cameras():
            bus_hz = one.bus_hz if one.states("bus") else 1e6 * (self.bus_mev_s or math.inf)
            said = replace(one, bus_hz=bus_hz)
            if not one.name:
                said = replace(said, width=None, height=None)
            own = "contrast_thresholds" in own_of(one)
            thresholds = () if own else self.contrast_thresholds
            lines[said.assumptions(**light, thresholds=thresholds)] = None
        kinds = {one.sources["threshold"].kind for one in self.cameras if one.states("threshold")}
        if len(kinds) > 1:
            lines[f"thresholds are not comparable: {', '.join(sorted(kinds))}"] = None
        return [*lines]

    def sizes(self, render: Render) -> list[tuple[int, int]]:
        """Return (width, height) of all sensors, px, for frames of these settings."""
        return [one.size for one in self.all_cameras(render)]

    def warm_up_of(
        self, cutoff_hz: float, speed: float, time_constants: float | None = None
    ) -> float:
        """Return the warm-up of a sensor at a speed, s of the path, whatever is beside it.

        Parameters
        ----------
        cutoff_hz, speed, time_constants
            As for `tasks.warm_up.needed_s`; by default of the study's time constants.

        Returns
        -------
        seconds
        """
        if time_constants is None:
            time_constants = self.warmup_time_constants
        return needed_s(cutoff_hz, speed, self.warm_up_s, time_constants)

    @property
    def longest_warm_up_s(self) -> float:
        """The longest warm-up of all sensors, seconds of the path."""
        found = [
            self.warm_up_of(model.cutoff_hz, max(self.speeds), camera.warm_up)
            for camera, _, model in self.models()
        ]
        return max(found, default=self.warm_up_s)

    @property
    def decides(self) -> dict[str, object]:
        """Fields that name results. Those added later are included only if they are used."""
        found = {one.name: getattr(self, one.name) for one in fields(self)}
        del found["warm_up_s"], found["area_exponents"]  # the clip and the cameras hold them
        readings = found.pop("photoreceptors")
        if readings != ("two_pole",):
            found["photoreceptor"] = readings[0] if len(readings) == 1 else readings
        named = [one for one in self.all_cameras() if one.name]
        found["sensors"] = [
            {
                "name": one.name,
                "in_light": [light.on(one) for light in self.lights],
                "own": own_of(one),
                "readout": self.readout(one) if any(map(one.states, BUS_KEYS)) else None,
                "warm_up": one.warm_up if one.states("warm_up") else None,
            }
            for one in named
        ]
        if not named:
            del found["sensors"]
        return found

    def models(
        self, render: Render = _ANY, white: float = 1.0
    ) -> Iterator[tuple[EventCamera, StudyLight, SensorModel]]:
        """Yield each camera in each light, with each photoreceptor and threshold.

        A camera without a cutoff comes once, as it is the same with any photoreceptor.

        Parameters
        ----------
        render
            Frames, whose shape plain cameras have.
        white
            Radiance of white in them.

        Yields
        ------
        camera, light, model
        """
        for camera in self.all_cameras(render):
            own = own_of(camera)
            thresholds = (None,) if "contrast_thresholds" in own else self.contrast_thresholds
            kinds = (None,) if "photoreceptors" in own else self.photoreceptors
            for light in self.lights:
                ideal = math.isinf(light.on(camera).cutoff_hz)
                for kind in kinds[:1] if ideal else kinds:
                    pixels = camera if kind is None else replace(camera, photoreceptor=kind)
                    for C in thresholds:
                        if C is not None:
                            pixels = replace(pixels, contrast_threshold=C)
                        yield camera, light, light.on(pixels, white)

    def at_factors(self, base_speed_m_s: float) -> Simulate:
        """Return the same sensors with speeds as factors on the base speed of a scene."""
        if self.speeds_m_s is None:
            return self
        return replace(self, speeds=tuple(speed / base_speed_m_s for speed in self.speeds_m_s))

    def first(self, render: Render) -> Simulate:
        """Return the smallest sensor alone, in the first light at the first speed."""
        smallest = min(self.all_cameras(render), key=lambda one: math.prod(one.size))
        named = [one for one in self.cameras if one.size == smallest.size][:1]
        lux, speeds_m_s = self.illuminance_lux, self.speeds_m_s
        return replace(
            self,
            widths=() if named else smallest.size[:1],
            cutoffs_hz=self.cutoffs_hz[:1],
            contrast_thresholds=self.contrast_thresholds[:1],
            speeds=self.speeds[:1],
            photoreceptors=self.photoreceptors[:1],
            sensors=tuple(named),
            area_exponents=None,
            illuminance_lux=lux and lux[:1],
            speeds_m_s=speeds_m_s and speeds_m_s[:1],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """A study: which scenes, under which light, seen by which sensors, for which tasks.

    Parameters
    ----------
    name
        Name of the study.
    scenes
        Names or folders of scenes, or Mitsuba files (.xml).
    question
        What the study asks, the title of its report; None for a general question.
    render, simulate, evaluate
        How scenes are rendered, which sensors see them, and how their events are scored.
    trajectories
        Files of poses in TUM format by scene, in place of the scenes' own paths.

    Raises
    ------
    StudyError
        If a list of sensor settings is empty or has a value twice, a sensor is finer than the
        frames, sensors contradict each other, a bus carries nothing, a distance is given without
        speeds in m/s or with `same_lens`, or a number is out of range.
    """

    name: str
    scenes: tuple[str, ...]
    question: str | None = None
    render: Render = field(default_factory=Render)
    simulate: Simulate = field(default_factory=Simulate)
    evaluate: Evaluate = field(default_factory=Evaluate)
    trajectories: dict[str, str] | None = None

    def __post_init__(self) -> None:
        rules.check(self)


def to_json(study: Study) -> dict[str, Any]:
    """Return the study as plain JSON values; inf becomes "inf"."""
    values: dict[str, Any] = json_values(study, optional=_LEFT_OUT_IF_NOT_GIVEN)
    if study.simulate.speeds_m_s is not None:  # factors are then not used
        del values["simulate"]["speeds"]
    return values
