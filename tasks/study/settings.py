"""Settings of a study: nested frozen dataclasses, Render -> Simulate -> Evaluate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from eres_render.errors import check_positive, check_spp, nearest
from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.json_values import json_values, use_python_numbers
from eres_render.storage.settings_reader import FloatOrInf
from sensor.cameras import EventCamera
from sensor.errors import SensorError
from sensor.levels import DARK_FRACTION
from sensor.model import Photoreceptor, SensorModel
from sensor.optics import crop_to_aspect
from tasks.errors import StudyError
from tasks.evaluation.settings import MAY_BE_ZERO, Evaluate, unlike_two_poles
from tasks.registry import TASKS
from tasks.study.sensors import (
    BUS_KEYS,
    Light,
    bus_of,
    light_at,
    own_of,
    with_area_exponents,
)
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

_LEAST_HZ = 1e-3  # warms up for a quarter of an hour
_MOST_THRESHOLD = math.log(65504 / 2**-24)  # frames are half-floats
_LONGEST_S = 2000.0  # sensors take less than 2147 s between two frames
_LEAST_DISPLACEMENT_PX = 0.001
LEAST_RESOLUTION = 62
"""Least side of a frame, px: `sensor.statistics.slopes_by_pixel_size` needs it for its blocks."""


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
    def lights(self) -> tuple[Light, ...]:
        """The lights on the scene."""
        if self.illuminance_lux is None:
            return tuple(map(Light, self.cutoffs_hz))
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
    ) -> Iterator[tuple[EventCamera, Light, SensorModel]]:
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
        _check_numbers("render", self.render)
        _check_numbers("simulate", self.simulate)
        for task, settings in self.evaluate.items():
            _check_numbers(f"evaluate.{task}", settings)
        _check_list("scenes", self.scenes)
        for scene in self.trajectories or {}:
            if scene not in self.scenes:
                raise StudyError(
                    f"trajectories: found {scene!r}, expected one of scenes; "
                    f"{nearest(scene, self.scenes)}"
                )
        for name in (
            *(
                name  # before the fields that follow from it
                for name in ("illuminance_lux", "speeds_m_s")
                if getattr(self.simulate, name) is not None
            ),
            *("cutoffs_hz", "contrast_thresholds", "speeds", "photoreceptors"),
            *(("widths",) if self.simulate.widths or not self.simulate.sensors else ()),
        ):
            _check_list(f"simulate.{name}", getattr(self.simulate, name))
        for name, side in (("resolution", self.render.resolution), ("height", self.render.height)):
            if side is not None and side < LEAST_RESOLUTION:
                raise StudyError(
                    f"render.{name}: found {side} px, expected at least {LEAST_RESOLUTION}, which "
                    "the scaling statistics need"
                )
        check_spp(self.render.spp, StudyError)
        if (px := self.render.max_displacement_px) < _LEAST_DISPLACEMENT_PX:
            raise StudyError(
                f"render.max_displacement_px: found {px}, expected at least "
                f"{_LEAST_DISPLACEMENT_PX} px"
            )
        if self.render.seed >= 1 << 32:
            raise StudyError(f"render.seed: found {self.render.seed}, expected less than 2^32")
        if max(self.simulate.widths, default=0) > self.render.resolution:
            raise StudyError(
                f"simulate.widths: found {max(self.simulate.widths)} px, expected at most "
                f"{self.render.resolution}, which is render.resolution"
            )
        self._check_sensors()
        try:
            models = [model for *_, model in self.simulate.models(self.render)]
        except SensorError as error:
            raise StudyError(f"simulate: {error}") from None
        slowest_hz = min(model.cutoff_hz for model in models)
        if slowest_hz < _LEAST_HZ:
            raise StudyError(
                f"simulate: found a cutoff of {slowest_hz:g} Hz, expected at least {_LEAST_HZ:g} Hz"
            )
        highest = max(min(model.contrast_threshold, model.off_threshold) for model in models)
        if highest > _MOST_THRESHOLD:
            raise StudyError(
                f"simulate: found a contrast threshold of {highest:g}, expected at most "
                f"{_MOST_THRESHOLD:.3g}, the log of the brightest over the darkest pixel of a frame"
            )
        if self.simulate.speeds_m_s is None:  # otherwise windows depend on the scene
            check_buses(self.simulate, self.render)
        self._check_distance()
        self._check_tasks()

    def _check_distance(self) -> None:
        """Refuse a distance without speeds in m/s, or for widths that have their own."""
        place, found = "simulate.distance_m", self.simulate.distance_m
        if found is None:
            return
        check_positive(place, found, StudyError)
        if self.simulate.speeds_m_s is None:
            raise StudyError(
                f"{place}: found {found:g} m and speeds that are factors, expected "
                "simulate.speeds_m_s"
            )
        if self.simulate.same_lens:
            raise StudyError(
                f"{place}: found {found:g} m and simulate.same_lens, which gives each width a "
                "distance, expected one of them"
            )

    def _check_sensors(self) -> None:
        """Refuse a camera without a name or a grid, one finer than the frames, or a name twice."""
        for sensor in self.simulate.sensors:
            at = f"simulate.sensors: found {sensor.name!r}"
            render = self.render
            try:
                width, height = sensor.size
            except SensorError as error:
                raise StudyError(f"simulate.sensors: {error}") from None
            if not sensor.name:
                raise StudyError(
                    f"simulate.sensors: found a camera of {width}x{height} px without a name, "
                    "expected a name, or its width in simulate.widths"
                )
            seen = render.seen_px(width, height)
            if width > seen[0] or height > seen[1]:
                raise StudyError(
                    f"{at} of {width}x{height} px, finer than the frames, of whose "
                    f"{render.resolution}x{render.height_at(render.resolution)} px it sees "
                    f"{seen[0]}x{seen[1]}, expected a larger render.resolution"
                )
        self._check_area_exponents()
        if self.simulate.sensors:
            _check_list("simulate.sensors", tuple(one.name for one in self.simulate.cameras))

    def _check_area_exponents(self) -> None:
        """Refuse exponents that are out of range, given twice, or without light in lux."""
        place, exponents = "simulate.area_exponents", self.simulate.area_exponents
        if exponents is None:
            return
        _check_list(place, exponents)
        if max(exponents) > 1:
            raise StudyError(f"{place}: found {max(exponents)}, expected numbers from 0 to 1")
        if self.simulate.illuminance_lux is None:
            raise StudyError(
                f"{place}: found {exponents} and cutoffs, expected simulate.illuminance_lux, from "
                "which cutoffs follow"
            )

    def _check_tasks(self) -> None:
        """Refuse settings that give a row twice or none, and oracles next to another
        photoreceptor."""
        tracking = self.evaluate["tracking"]
        if tracking.methods and getattr(tracking, "sigmas_mm", None) == ():
            raise StudyError("evaluate.tracking.sigmas_mm: found none, expected one or more")
        for task, settings in self.evaluate.items():
            for stretches, planned in settings.plan().items():
                if planned.methods:
                    _check_list(f"evaluate.{task}, methods", planned.methods)
                speeds = () if self.simulate.speeds_m_s else self.simulate.speeds
                twice = set(stretches.speeds) & set(speeds)
                if planned.methods and twice:
                    raise StudyError(
                        f"evaluate.{task}: found methods for a speed of {max(twice):g}, which "
                        "simulate.speeds has for all methods, expected another speed"
                    )
            self._check_diagnostics(task, settings.methods)

    def _check_diagnostics(self, task: str, methods: tuple[str, ...]) -> None:
        asked = [name for name in methods if TASKS[task].method(name).role == "diagnostic"]
        models = [model for *_, model in self.simulate.models(self.render)] if asked else []
        for model in models:
            if found := unlike_two_poles(model):
                raise StudyError(
                    f"evaluate.{task}.methods: found {asked[0]!r}, which is about two poles, and "
                    f"{found}, expected only 'two_pole' with one cutoff"
                )


def check_speeds(place: str, simulate: Simulate, render: Render) -> None:
    """Refuse speeds whose window is shorter than a microsecond or longer than half an hour."""
    window_us = 1e6 * render.window_s
    least, most = render.window_s / _LONGEST_S, window_us
    for speed in simulate.speeds:
        if not least <= speed <= most:
            raise StudyError(
                f"{place}: found {speed:g} times the base speed, at which a window of "
                f"{1e3 * render.window_s:g} ms lasts {render.window_s / speed:.3g} s, expected "
                f"{least:.3g} to {most:g}"
            )


def check_buses(simulate: Simulate, render: Render) -> None:
    """Refuse a bus that carries less than one event per window, or a queue without a bus."""
    window_s = render.window_s / max(simulate.speeds)
    for one in simulate.all_cameras(render):
        bus, own = simulate.readout(one), [key for key in BUS_KEYS if one.states(key)]
        if own and bus is None and "bus" not in own:
            raise StudyError(
                f"simulate.sensors: {one.name!r}: {own[0]}: found no bus, expected one of its own "
                "or simulate.bus_mev_s"
            )
        if bus is None or bus.row_overhead_s + 1 / bus.max_rate_hz <= window_s:
            continue
        overhead_s = bus.row_overhead_s
        expected = (
            f"at least {1e-6 / (window_s - overhead_s):g}"
            if overhead_s < window_s
            else f"a row_overhead of less than {window_s:g} s"
        )
        decisive = [key for key in own if key != "fifo"]
        place = f"sensors: {one.name!r}: {decisive[0]}" if decisive else "bus_mev_s"
        raise StudyError(
            f"simulate.{place}: found {bus.max_rate_hz / 1e6:g} Mev/s"
            f"{f' with a row_overhead of {overhead_s:g} s' if overhead_s else ''}, which carries "
            f"no event in a window of {1e3 * window_s:g} ms, expected {expected}"
        )


def _check_list(place: str, values: tuple[Any, ...]) -> None:
    if not values:
        raise StudyError(f"{place}: found none, expected one or more")
    if len(set(values)) < len(values):
        raise StudyError(f"{place}: found {values}, expected each of them once")


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


def to_json(study: Study) -> dict[str, Any]:
    """Return the study as plain JSON values; inf becomes "inf"."""
    values: dict[str, Any] = json_values(study, optional=_LEFT_OUT_IF_NOT_GIVEN)
    if study.simulate.speeds_m_s is not None:  # factors are then not used
        del values["simulate"]["speeds"]
    return values
