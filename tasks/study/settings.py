"""Settings of a study: nested frozen dataclasses, Render -> Simulate -> Evaluate."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.json_values import json_values, use_python_numbers
from eres_render.storage.settings_reader import FloatOrInf
from sensor import EventCamera
from sensor.cameras.camera import BUS_KEYS
from sensor.levels import DARK_SHARE
from sensor.model import Photoreceptor, SensorModel, cutoff_in_light
from sensor.optics import crop_to_aspect
from tasks.errors import StudyError
from tasks.evaluation.sensor_setting import Emulation
from tasks.evaluation.settings import MAY_BE_ZERO, Evaluate
from tasks.study import rules
from tasks.warm_up import TIME_CONSTANTS, needed_s

if TYPE_CHECKING:
    from sensor import Readout
    from sensor.emulators.v2e_steps import Version

# Fields that study.json has only if they are given.
_LEFT_OUT_IF_NOT_GIVEN = (
    *("question", "weights", "other_equalizations", "e2vid_window_s", "e2vid_events_per_px"),
    *("height", "same_lens", "tracking_window_s", "sensors", "area_exponents", "illuminance_lux"),
    *("speeds_m_s", "distance_m", "bus_mev_s", "trajectories", "frame_steps_px", "starts"),
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


class StudyLight(NamedTuple):
    """Light on the scene: the cutoff of plain sensors in Hz, and the illuminance in lux or 0."""

    cutoff_hz: float
    illuminance_lux: float = 0.0

    def on(self, camera: EventCamera, white: float = 1.0) -> SensorModel:
        """Return the pixels of a camera in this light."""
        if self.illuminance_lux:
            return camera.model(lux=self.illuminance_lux, white=white)
        return camera.model(cutoff_hz=self.cutoff_hz, white=white)


def own_of(camera: EventCamera) -> tuple[str, ...]:
    """Return the settings of a study that a camera overrides with a value of its own."""
    own = {
        "contrast_thresholds": camera.states("threshold") or camera.states("threshold_off"),
        "photoreceptors": camera.states("photoreceptor") or camera.cutoff_follows_light,
        "bus": camera.states("bus") and camera.bus is None,
    }
    return tuple(name for name, holds in own.items() if holds)


AREA = "area^"
"""Before the exponent in the name of a camera with an exponent of `area_exponents`."""

Simulator = Literal["exact", "v2e", "v2e-A", "v2e-B"]
_VERSIONS: dict[Simulator, Version] = {"v2e": "C", "v2e-A": "A", "v2e-B": "B"}

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
        Shortest warm-up before a window, seconds of the path.
    warmup_time_constants
        Shortest warm-up before a window, in time constants of the sensor's filter at its speed.
    photoreceptors
        Each is "two_pole", "one_pole" or "v2e" (v2e's limit for small steps), see
        `sensor.SensorModel`. "two_pole" becomes the first, which the report shows in full.
    simulators
        Each is "exact", or v2e's program as `sensor.emulators.v2e`, which has a photoreceptor of
        its own: "v2e" for its version C, "v2e-A" or "v2e-B".
    frame_steps_px
        Image motion between the frames that v2e sees, px of the rendered frames: multiples of
        `render.max_displacement_px`, of which it sees every so many. None for every frame.
    sensors
        Cameras, each with a name, in addition to the widths. Their own values override
        `contrast_thresholds`, `photoreceptors`, `dark_fraction`, `warmup_time_constants` and
        `bus_mev_s`.
    area_exponents
        Exponents of the photodiode's area for cameras that borrow their cutoff. Each exponent makes
        one sensor of such a camera. None keeps the cameras' own exponents.
    illuminance_lux
        Illuminance of the scene, lux, in place of `cutoffs_hz`, which follow from it.
    speeds_m_s
        Mean speeds of the camera, m/s, in place of `speeds`, which follow from them for each scene.
    distance_m
        Median distance between camera and plane along the optical axis, m; needs `speeds_m_s`.
        Scene and path are scaled to it, which leaves the images unchanged. None keeps each scene's
        distance.
    bus_mev_s
        Capacity of the bus of all sensors that have none of their own, million events per second;
        None for no bus. Events wait for it in a queue of the sensor's own length.
    same_lens
        Whether all widths are one camera at several distances from a plane that it faces: half the
        width is twice the distance. Images are the same as with larger pixels; poses are not. None
        means no.

    Raises
    ------
    StudyError
        `illuminance_lux` and `cutoffs_hz` are both given and contradict each other.
    """

    widths: tuple[int, ...] = (128, 240, 346, 640, 1280)
    cutoffs_hz: tuple[FloatOrInf, ...] = (math.inf, 200.0, 50.0)
    contrast_thresholds: tuple[float, ...] = (0.2,)
    speeds: tuple[float, ...] = (1.0, 4 / 3, 2.0)
    dark_fraction: float = field(default=DARK_SHARE, metadata=MAY_BE_ZERO)
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
    simulators: tuple[Simulator, ...] = ("exact",)
    frame_steps_px: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        use_python_numbers(self)
        in_order = tuple(sorted(self.photoreceptors, key=lambda name: name != "two_pole"))
        object.__setattr__(self, "photoreceptors", in_order)
        if min(self.illuminance_lux or (0.0,)) <= 0:  # not given, or for `Study` to refuse
            return
        cutoffs_hz = tuple(light.cutoff_hz for light in self.lights)
        default = {field.name: field.default for field in fields(self)}["cutoffs_hz"]
        if self.cutoffs_hz not in (cutoffs_hz, default):
            raise StudyError(f"give cutoffs_hz = {self.cutoffs_hz} or illuminance_lux, not both")
        object.__setattr__(self, "cutoffs_hz", cutoffs_hz)

    @property
    def lights(self) -> tuple[StudyLight, ...]:
        """The lights on the scene."""
        if self.illuminance_lux is None:
            return tuple(map(StudyLight, self.cutoffs_hz))
        return tuple(
            StudyLight(math.inf) if math.isinf(lux) else StudyLight(cutoff_in_light(lux), lux)
            for lux in self.illuminance_lux
        )

    @property
    def cameras(self) -> tuple[EventCamera, ...]:
        """The named cameras, those that borrow their cutoff once for each exponent of the area."""
        every: list[EventCamera] = []
        for camera in self.sensors:
            borrows = camera.borrows_cutoff and camera.area_um2 is not None
            every += [
                replace(camera, name=f"{camera.name} {AREA}{power:g}", area_exponent=power)
                for power in self.area_exponents or ()
                if borrows
            ] or [camera]
        return tuple(every)

    def readout(self, camera: EventCamera) -> Readout | None:
        """Return the bus of a camera, or that of the study; None for no bus."""
        if self.bus_mev_s is None or camera.states("bus"):
            return camera.bus
        return replace(camera, bus_hz=1e6 * self.bus_mev_s).bus

    def all_cameras(self, render: Render = _ANY) -> list[EventCamera]:
        """Return the plain and the named cameras, for frames of these settings."""
        plain = EventCamera(dark_share=self.dark_fraction, warm_up=self.warmup_time_constants)
        every = [plain.on(width, render.height_at(width)) for width in self.widths]
        for camera in self.cameras:
            names = {"dark": "dark_share", "warm_up": "warm_up"}
            lacks = [name for key, name in names.items() if not camera.states(key)]
            every.append(replace(camera, **{name: getattr(plain, name) for name in lacks}))
        return every

    @property
    def assumes(self) -> list[str]:
        """In words what the study assumes of its cameras, a line each."""
        lux, cutoffs_hz = self.illuminance_lux, self.cutoffs_hz
        light: dict[str, Any] = {"cutoff_hz": cutoffs_hz} if lux is None else {"lux": lux}
        lines: dict[str, None] = {}
        for camera in self.all_cameras():
            if not camera.states("bus"):
                camera = replace(camera, bus_hz=1e6 * (self.bus_mev_s or math.inf))
            thresholds = () if "contrast_thresholds" in own_of(camera) else self.contrast_thresholds
            if not camera.name:
                camera = replace(camera, width=None, height=None)
            lines[camera.assumptions(**light, thresholds=thresholds)] = None
        kinds = {c.sources["threshold"].kind for c in self.cameras if c.states("threshold")}
        if len(kinds) > 1:
            lines[f"thresholds are not comparable: {', '.join(sorted(kinds))}"] = None
        return [*lines]

    @property
    def longest_warm_up_s(self) -> float:
        """The longest warm-up of all sensors, seconds of the path."""
        return max(
            needed_s(model.cutoff_hz, max(self.speeds), self.warm_up_s, camera.warm_up)
            for camera, _, model in self.models()
        )

    @property
    def decides(self) -> dict[str, object]:
        """Fields that name results. Those added later are included only if they are used."""
        named = [
            {
                "name": camera.name,
                "in_light": [light.on(camera) for light in self.lights],
                "own": own_of(camera),
                "readout": self.readout(camera) if any(map(camera.states, BUS_KEYS)) else None,
                "warm_up": camera.warm_up if camera.states("warm_up") else None,
            }
            for camera in self.all_cameras()
            if camera.name
        ]
        # The clip and the cameras hold the warm-up and the exponents.
        elsewhere = ["warm_up_s", "area_exponents", "photoreceptors", "sensors"]
        later = {"simulators": ("exact",), "frame_steps_px": None}
        elsewhere += [name for name, default in later.items() if getattr(self, name) == default]
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in elsewhere}
        if self.photoreceptors != ("two_pole",):
            first, *others = self.photoreceptors
            values["photoreceptor"] = self.photoreceptors if others else first
        return values | ({"sensors": named} if named else {})

    def models(
        self, render: Render = _ANY, white: float = 1.0
    ) -> tuple[tuple[EventCamera, StudyLight, SensorModel], ...]:
        """Return each camera in each light, with each photoreceptor and threshold.

        A camera without a cutoff comes once, as it is the same with any photoreceptor.

        Parameters
        ----------
        render
            Frames, whose shape plain cameras have.
        white
            Radiance of white in them.

        Returns
        -------
        tuple of (camera, light, model)
        """
        sources = tuple(tuple(camera.sources.items()) for camera in self.sensors)
        return _models(self, render, white, sources)

    def emulations(self, render: Render, white: float = 1.0) -> list[Emulation | None]:
        """Return what simulates each sensor's pixels.

        Parameters
        ----------
        render
            Frames, of which programs see every so many.
        white
            Radiance of white in them.

        Returns
        -------
        list
            None for the exact engine.
        """
        steps_px = self.frame_steps_px or (render.max_displacement_px,)
        programs: list[Emulation | None] = [None] if "exact" in self.simulators else []
        versions = [_VERSIONS[name] for name in self.simulators if name in _VERSIONS]
        for version, step_px in product(versions, steps_px):
            every = round(step_px / render.max_displacement_px)
            programs.append(Emulation(version, every, white, f"v2e-{version}-{step_px:g}px"))
        return programs

    def first(self, render: Render) -> Simulate:
        """Return the smallest sensor alone, in the first light at the first speed."""
        size = min((camera.size for camera in self.all_cameras(render)), key=math.prod)
        named = tuple(camera for camera in self.cameras if camera.size == size)[:1]
        values: dict[str, Any] = {f.name: getattr(self, f.name) for f in fields(self)}
        values = {name: value[:1] for name, value in values.items() if isinstance(value, tuple)}
        values |= {"widths": () if named else size[:1], "sensors": named, "area_exponents": None}
        return replace(self, **values)


@lru_cache(maxsize=64)  # every job of a study asks again; equal cameras may have other sources
def _models(
    simulate: Simulate, render: Render, white: float, _sources: object
) -> tuple[tuple[EventCamera, StudyLight, SensorModel], ...]:
    found = []
    for camera in simulate.all_cameras(render):
        own, own_C = own_of(camera), camera.contrast_threshold
        thresholds = (own_C,) if "contrast_thresholds" in own else simulate.contrast_thresholds
        kinds = (camera.photoreceptor,) if "photoreceptors" in own else simulate.photoreceptors
        for light in simulate.lights:
            ideal = math.isinf(light.on(camera).cutoff_hz)
            for kind, C in product(kinds[:1] if ideal else kinds, thresholds):
                pixels = replace(camera, photoreceptor=kind, contrast_threshold=C)
                found.append((camera, light, light.on(pixels, white)))
    return tuple(found)


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
        A list of sensor settings is empty or has a value twice, a sensor is finer than the frames,
        sensors contradict each other, a distance is given without speeds in m/s or with
        `same_lens`, or a number is out of range.
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
