"""Advice: the lags of sensors in one view, their event rates, and the width to choose."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median

from eres_render.errors import check_positive
from sensor import EventCamera
from tasks.advice.law import chosen, delay_s, finer_wins, lag_px
from tasks.advice.stored import Case, stored_cases, stored_cells, stored_windows
from tasks.errors import TaskError

WIDTHS = (128, 240, 346, 640, 1280)
FOV_DEG = 60.0
"""Field of view if none is given: that of the packaged scenes."""
WINDOW_S = 0.05
"""Length of the window of a reconstruction if none is given: that of the study."""
_SAME = 1.05  # ratio of cutoffs that count as equal
EXPONENTS = (0.0, 1.0)
"""Ends between which the exponent of the photodiode's area in the cutoff lies."""

_NEAR = 1.25  # lags within this factor are near
_FEW = 9  # windows of a scene of which an event rate is the median


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """What the sensors look at.

    Parameters
    ----------
    speed
        Speed of the camera relative to what it sees, along the image, m/s.
    distance
        Distance of what it sees, m.
    fov
        Horizontal field of view, degrees.
    lux
        Light on the scene, lux; None for `cutoff`, or the camera's own.
    cutoff
        Cutoff in place of `lux`, Hz: that of the finest sensor.
    image
        Image of it, as wide as the field of view, which decides in place of the law; or None. With
        it, photoreceptors may have one pole.
    direction
        Where that image moves, degrees, as for `tasks.advice.spectrum.MovingImage`.
    window
        Length of the window of a reconstruction, s.

    Raises
    ------
    TaskError
        A number is not positive, or the light is given twice.
    """

    speed: float
    distance: float
    fov: float = FOV_DEG
    lux: float | None = None
    cutoff: float | None = None
    image: Path | None = None
    direction: float | None = None
    window: float = WINDOW_S

    def __post_init__(self) -> None:
        for name in ("speed", "distance", "lux", "cutoff", "window"):
            if (value := getattr(self, name)) is not None:
                check_positive(name, value, TaskError)
        if not 0 < self.fov < 180:
            raise TaskError(f"fov: found {self.fov}, expected degrees between 0 and 180")
        if self.lux is not None and self.cutoff is not None:
            raise TaskError("give --lux or --cutoff, not both")

    def speed_px_s(self, width: int) -> float:
        """Return the speed of the image on a sensor, px/s."""
        focal_px = width / 2 / math.tan(math.radians(self.fov) / 2)
        return self.speed / self.distance * focal_px

    def cutoffs_hz(self, camera: EventCamera) -> list[float]:
        """Return the cutoff of a camera for each of `EXPONENTS`, Hz.

        If it is lent, and the area of the photodiodes is unknown, only the first is known.
        """
        if camera.photoreceptor != "two_pole" and not (
            self.image and camera.photoreceptor == "one_pole"
        ):
            raise TaskError(
                f"{camera.name}: the law is about photoreceptors of two poles, --image also about "
                f"those of one, and this one is {camera.photoreceptor!r}"
            )
        if self.lux is not None:
            known = camera.area_um2 is not None or not camera.borrows_cutoff
            ends = EXPONENTS if known else EXPONENTS[:1]
            return [replace(camera, area_exponent=g).cutoff_at(self.lux) for g in ends]
        cutoff_hz = camera.cutoff_hz if self.cutoff is None else self.cutoff
        if math.isinf(cutoff_hz):
            raise TaskError("the light decides the lag; give --lux or --cutoff")
        return [cutoff_hz] * len(EXPONENTS)


@dataclass(frozen=True, slots=True)
class Sensor:
    """A sensor in a view.

    Attributes
    ----------
    cutoffs_hz, lags_px
        For each of `EXPONENTS`, or only for the first; lags are px of the sensor.
    events_hz
        Smallest and largest of the event rates that stored scenes say, events/s; None if their lags
        are all smaller.
    bus_hz
        Capacity of its bus, events/s; inf if it is unknown.
    cases
        Number of stored cases whose lag is near its first one.
    finer_won
        Share of these in which the finer sensor has the better image; None without any.
    margin_db
        Their median PSNR of the finer minus that of the coarser, dB.
    contrast_threshold
        Of ON events, log units.
    poles
        Number of poles of its photoreceptor; the stored cases have two.
    predicted_db
        For each of `lags_px`, the PSNR of event integration as the image predicts it, dB; none
        without an image.
    """

    name: str
    width: int
    height: int
    speed_px_s: float
    cutoffs_hz: tuple[float, ...]
    lags_px: tuple[float, ...]
    events_hz: tuple[float, float] | None
    bus_hz: float
    cases: int
    finer_won: float | None
    margin_db: float | None
    contrast_threshold: float
    poles: int
    predicted_db: tuple[float, ...] = ()

    @property
    def right(self) -> float | None:
        """Share of these cases in which the law is right."""
        if self.finer_won is None or finer_wins(self.lags_px[0]):
            return self.finer_won
        return 1 - self.finer_won


@dataclass(frozen=True, slots=True)
class Choice:
    """The sensor to choose at one exponent of the photodiode's area.

    Attributes
    ----------
    delay_s
        Delay of its pixels, s.
    late_m
        Way of the camera during it, m.
    """

    area_exponent: float
    sensor: str
    delay_s: float
    late_m: float


@dataclass(frozen=True, slots=True)
class Advice:
    """Which sensors to choose.

    Attributes
    ----------
    sensors
        All of them, from the coarsest to the finest.
    choices
        For each of `EXPONENTS` that has the lags of all sensors.
    right
        Share of stored cases in which the law is right, near the lag of the first choice or near
        that of the next finer sensor: the smaller of both; None if there are no cases near one, or
        if an image decides.
    nearest
        Medians of the stored cases most like the step from the first choice to the next finer
        sensor, or to the choice if that is the finest; None for a single sensor, or one pole.
    """

    sensors: tuple[Sensor, ...]
    choices: tuple[Choice, ...]
    right: float | None
    nearest: Case | None


def fov_of(width: int, pitch_um: float | None, focal_length_mm: float) -> float:
    """Return the horizontal field of view of a chip behind a lens.

    Parameters
    ----------
    width
        Width, px.
    pitch_um
        Side of a pixel, um; None if it is unknown.
    focal_length_mm
        Focal length, mm.

    Returns
    -------
    float
        Degrees.

    Raises
    ------
    TaskError
        A number is not positive, or the pitch is unknown.
    """
    if pitch_um is None:
        raise TaskError("focal_length: needs a pitch, which is unknown; give --pitch or --fov")
    check_positive("pitch", pitch_um, TaskError)
    check_positive("focal_length", focal_length_mm, TaskError)
    return math.degrees(2 * math.atan(width * pitch_um / 2e3 / focal_length_mm))


def ladder(view: View, chip: EventCamera, widths: Iterable[int]) -> list[Sensor]:
    """Return sensors of several widths on the chip of a camera, in the same field of view.

    Their pixels are larger than the camera's, and equal to them in all else; with an exponent g of
    the area, a pixel that is p times as wide has p^2g times the cutoff.

    Parameters
    ----------
    view
        What they look at.
    chip
        The camera; it has a size.
    widths
        Widths, px.

    Returns
    -------
    list of Sensor
        From the coarsest to the finest.
    """
    full, height = chip.size
    ends, sensors = [*zip(EXPONENTS, view.cutoffs_hz(chip), strict=False)], []
    for width in sorted({*widths}):
        check_positive("widths", width, TaskError)
        faster = [cutoff_hz * (full / width) ** (2 * g) for g, cutoff_hz in ends]
        size = width, max(1, round(width * height / full))
        coarser = replace(chip.on(*size), name="x".join(map(str, size)))
        sensors.append(_sensor(view, coarser, faster))
    return sensors


def line_up(view: View, cameras: Iterable[EventCamera]) -> list[Sensor]:
    """Return cameras in the same field of view, each behind a lens of its own.

    Parameters
    ----------
    view
        What they look at.
    cameras
        The cameras; each has a size.

    Returns
    -------
    list of Sensor
        From the coarsest to the finest.

    Raises
    ------
    TaskError
        Two have the same width.
    """
    ordered = sorted(cameras, key=lambda camera: camera.size)
    for camera, other in pairwise(ordered):
        if camera.width == other.width:
            names = f"{camera.name} and {other.name}"
            raise TaskError(f"{names} both have {camera.width} px; compare different widths")
    return [_sensor(view, camera, view.cutoffs_hz(camera)) for camera in ordered]


def _sensor(view: View, camera: EventCamera, cutoffs_hz: Sequence[float]) -> Sensor:
    width, height = camera.size
    speed_px_s = view.speed_px_s(width)
    poles = 2 if camera.photoreceptor == "two_pole" else 1
    lags_px = tuple(lag_px(speed_px_s, cutoff_hz, poles) for cutoff_hz in cutoffs_hz)
    events = [count for lag in {*lags_px} for count in _events_per_px(width, lag)]
    rates = [width * height * speed_px_s * count for count in events]
    cases = stored_cases() if poles == 2 else ()
    near = [case for case in cases if 1 / _NEAR < case.lag_px / lags_px[0] < _NEAR]
    return Sensor(
        name=camera.name,
        width=width,
        height=height,
        speed_px_s=speed_px_s,
        cutoffs_hz=tuple(cutoffs_hz),
        lags_px=lags_px,
        events_hz=(min(rates), max(rates)) if rates else None,
        bus_hz=camera.bus_hz,
        cases=len(near),
        finer_won=sum(case.finer_won for case in near) / len(near) if near else None,
        margin_db=median(case.margin_db for case in near) if near else None,
        contrast_threshold=camera.contrast_threshold,
        poles=poles,
    )


def _events_per_px(width: int, lag: float) -> Iterator[float]:
    """Yield the events of a pixel while the image moves by a pixel, by stored scene.

    Scenes whose lags are all smaller than `lag` yield nothing.
    """
    scenes: defaultdict[str, list[tuple[float, float]]] = defaultdict(list)
    for window in stored_windows():
        k = min(range(len(window.widths)), key=lambda k: abs(math.log(window.widths[k] / width)))
        scenes[window.scene].append((window.lag_px(window.widths[k]), window.events_per_px[k]))
    for pairs in scenes.values():
        if max(pairs)[0] > lag / _NEAR:
            nearest = sorted(pairs, key=lambda pair: abs(pair[0] - lag))[:_FEW]
            yield median(events for _, events in nearest)


def _psnr_db(view: View, sensors: Sequence[Sensor]) -> list[tuple[float, ...]]:
    """Return the PSNR that the image predicts for each lag of each sensor, or else a texture."""
    from tasks.advice import spectrum  # here: it takes a while to import

    *_, finest = sensors
    size = finest.width, finest.height
    picture = spectrum.read_picture(view.image, size[0]) if view.image else spectrum.texture(*size)
    moving = spectrum.MovingImage(picture, view.window * finest.speed_px_s, view.direction)
    predicted = []
    for sensor in sensors:
        lags_px = [lag * finest.width / sensor.width for lag in sensor.lags_px]
        psnr = moving.psnr_db(sensor.width, lags_px, sensor.contrast_threshold, sensor.poles)
        predicted.append(tuple(psnr))
    return predicted


def advise(view: View, sensors: Sequence[Sensor]) -> Advice:
    """Return which of the sensors to choose.

    Parameters
    ----------
    view
        What they look at.
    sensors
        From the coarsest to the finest, as `ladder` and `line_up` return them.

    Returns
    -------
    Advice

    Examples
    --------
    >>> from sensor import find_camera
    >>> from tasks.advice.advise import View, advise, ladder
    >>> view = View(speed=0.5, distance=0.5, lux=100)
    >>> sensors = ladder(view, find_camera("gen4-cd"), [128, 240, 346, 640, 1280])
    >>> [choice.sensor for choice in advise(view, sensors).choices]
    ['640x360', '346x195']
    """
    best, choices = [], []
    cutoffs_hz = [*zip(*(sensor.cutoffs_hz for sensor in sensors), strict=False)]
    unlike = [max(column) > _SAME * min(column) for column in cutoffs_hz]
    psnr_db = _psnr_db(view, sensors) if view.image or any(unlike) else []
    if view.image:
        sensors = [replace(s, predicted_db=p) for s, p in zip(sensors, psnr_db, strict=True)]
    for k, exponent in enumerate(EXPONENTS[: len(cutoffs_hz)]):
        if view.image or unlike[k]:  # the law is about sensors of one cutoff
            predicted = [each[k] for each in psnr_db]
            best.append(predicted.index(max(predicted)))
        else:
            best.append(chosen([sensor.lags_px[k] for sensor in sensors]))
        delay = delay_s(sensors[best[k]].cutoffs_hz[k], sensors[best[k]].poles)
        choices.append(Choice(exponent, sensors[best[k]].name, delay, view.speed * delay))
    steps = sensors[max(best[0], 1) : best[0] + 2]
    by_law = not view.image and not unlike[0]
    right = [step.right for step in steps if step.right is not None and by_law]
    last = min(best[0] + 1, len(sensors) - 1)
    return Advice(
        sensors=tuple(sensors),
        choices=tuple(choices),
        right=min(right) if right and len(right) == len(steps) else None,
        nearest=_nearest(sensors[last - 1], sensors[last])
        if last and sensors[last].poles == 2
        else None,
    )


def _nearest(coarser: Sensor, finer: Sensor) -> Case:
    """Return the stored medians whose lag and widths are most like those of two sensors."""

    def far(case: Case) -> float:
        lags, widths = case.lag_px / finer.lags_px[0], case.width / finer.width
        return sum(abs(math.log(x)) for x in (lags, widths, case.coarser / coarser.width))

    return min(stored_cells(), key=far)
