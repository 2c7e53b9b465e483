"""The sensors of a study: plain ones of its widths, and named cameras and sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eres_render.errors import nearest
from eres_render.storage.settings_reader import read_toml, read_typed
from sensor.errors import SensorError
from sensor.model import Photoreceptor, SensorModel, cutoff_in_light
from sensor.profiles import find_profile
from tasks.errors import StudyError, TaskError
from tasks.events.sensor_options import BusOptions, PixelOptions, find_grid, grid_names

if TYPE_CHECKING:
    from sensor import Readout


class Light(NamedTuple):
    """Light on the scene: the cutoff of plain sensors in Hz, and the illuminance in lux or 0."""

    cutoff_hz: float
    illuminance_lux: float = 0.0


def light_at(illuminance_lux: float) -> Light:
    """Return the light of an illuminance in lux; inf is light for ideal pixels."""
    if math.isinf(illuminance_lux):
        return Light(math.inf)
    return Light(cutoff_in_light(illuminance_lux), illuminance_lux)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySensor:
    """A sensor of a study: a plain one without noise, a camera, or one of the user's own.

    Parameters
    ----------
    name
        Name in rows and tables; "" for a plain sensor.
    in_light
        The sensor in each light of the study. Dark level and cutoff reference are fractions of the
        white level.
    own
        Settings of the study that the sensor overrides with a value of its own:
        "contrast_thresholds", "photoreceptors", "bus".
    readout
        Its bus, for a camera its own by default; None for that of the study, or for no bus if `own`
        has "bus".
    """

    name: str
    in_light: tuple[SensorModel, ...]
    own: tuple[str, ...] = ()
    readout: Readout | None = None

    @property
    def width(self) -> int:
        """Width, px."""
        return self.in_light[0].width

    @property
    def height(self) -> int:
        """Height, px."""
        return self.in_light[0].height


def bus_of(bus_mev_s: float) -> Readout | None:
    """Return a bus of this capacity, million events per second, with the default queue."""
    return BusOptions(bus=repr(bus_mev_s)).readout()


def plain_sensor(
    width: int, height: int, lights: Sequence[Light], dark_fraction: float
) -> StudySensor:
    """Return a sensor without noise in each light.

    Parameters
    ----------
    width, height
        Its size, px.
    lights
        The lights.
    dark_fraction
        Dark level as a fraction of the white level.

    Returns
    -------
    The sensor, without a name.
    """
    plain = SensorModel(width=width, height=height, dark_level=dark_fraction)
    models = tuple(replace(plain, cutoff_hz=light.cutoff_hz) for light in lights)
    return StudySensor(name="", in_light=models)


def with_pixels(
    model: SensorModel, contrast_threshold: float | None, photoreceptor: Photoreceptor | None
) -> SensorModel:
    """Return a sensor with another contrast threshold and another photoreceptor.

    Parameters
    ----------
    model
        The sensor; its cutoff reference is a fraction of the white level.
    contrast_threshold
        C of ON and OFF events, log units; None to keep those of the sensor.
    photoreceptor
        The photoreceptor; None to keep that of the sensor.

    Returns
    -------
    The sensor.
    """
    if contrast_threshold is not None:
        model = replace(model, contrast_threshold=contrast_threshold, contrast_threshold_off=None)
    if photoreceptor is None:
        return model
    white = photoreceptor == "v2e" and model.cutoff_hz < math.inf
    return replace(model, photoreceptor=photoreceptor, cutoff_reference=1.0 if white else None)


def in_radiance(model: SensorModel, white_level: float) -> SensorModel:
    """Return a sensor of a study with its levels in the frames' unit of radiance.

    Parameters
    ----------
    model
        The sensor; its dark level and cutoff reference are fractions of the white level.
    white_level
        Radiance of white.

    Returns
    -------
    The sensor, with both levels in units of radiance.
    """
    dark_level, reference = model.dark_level, model.cutoff_reference
    assert dark_level is not None, "the study has a dark fraction"
    return replace(
        model,
        dark_level=dark_level * white_level,
        cutoff_reference=None if reference is None else reference * white_level,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Body:
    """Fields of a sensor's table that are not in `PixelOptions` or `BusOptions`."""

    name: str | None = None
    sensor: str | None = None
    width: int | None = None
    height: int | None = None
    threshold: float | None = None


_TABLES = (_Body, PixelOptions, BusOptions)
_FROM_LIGHT = ("cutoff", "illuminance")  # fields of `PixelOptions` that the study's light sets


def read_sensor(
    found: Any,
    lights: Sequence[Light],
    dark_fraction: float,
    file: Path,
    place: str,
    bus_mev_s: float | None = None,
) -> StudySensor:
    """Read a sensor from an entry of `simulate.sensors`.

    Parameters
    ----------
    found
        The name of a camera, a TOML file, or a table. A table has `sensor`, `width` and `height`,
        or the `profile` of a camera, and may have `name`, `threshold` and the options of `eres
        simulate` for pixels and bus.
    lights
        The lights of the study.
    dark_fraction
        Dark level as a fraction of the white level.
    file, place
        File and field of the entry, for error messages. Paths are relative to the file.
    bus_mev_s
        Capacity of the study's bus, for a table with other options of a bus; None for no bus.

    Returns
    -------
    The sensor.

    Raises
    ------
    StudyError
        A camera or a profile does not exist, or values contradict each other.
    """
    name = None
    if isinstance(found, str) and found.endswith(".toml"):
        name, file, place = Path(found).stem, file.parent / found, ""
        found = read_toml(dict[str, Any], file, StudyError)
    table = {"sensor": found} if isinstance(found, str) else found
    where = f"{file}: {place}" if place else str(file)
    if not isinstance(table, dict):
        raise StudyError(f"{where}: found {found!r}, expected a camera, a file or a table")
    body, pixel, bus = _options(table, file, place)
    if body.sensor is None and body.width is None and pixel.profile in grid_names():
        body = replace(body, sensor=pixel.profile)  # the camera that the profile describes
    try:
        plain = replace(_plain(body), dark_level=dark_fraction)
        models = tuple(_lit(plain, body, _in_file(pixel, file), light) for light in lights)
        known_bus = body.sensor is not None and find_grid(body.sensor).bus_hz < math.inf
        if bus.bus is None and not known_bus and bus != BusOptions() and bus_mev_s is not None:
            bus = replace(bus, bus=repr(bus_mev_s))
        readout = bus.readout(body.sensor)
    except (SensorError, TaskError) as error:
        raise StudyError(f"{where}: {error}") from None
    known = {} if pixel.profile is None else find_profile(_in_file(pixel, file).profile or "").known
    own = []
    if {body.threshold, pixel.threshold_off} != {None} or {"threshold_on", "threshold_off"} & {
        *known
    }:
        own.append("contrast_thresholds")
    if pixel.photoreceptor or pixel.cutoff_follows_light or "photoreceptor" in known:
        own.append("photoreceptors")
    if bus.bus is not None and readout is None:
        own.append("bus")  # unlimited
    return StudySensor(
        name=body.name or name or body.sensor or f"{plain.width}x{plain.height}",
        in_light=models,
        own=tuple(own),
        readout=readout,
    )


def _options(
    table: dict[str, Any], file: Path, place: str
) -> tuple[_Body, PixelOptions, BusOptions]:
    """Read the table of a sensor, each field with the class that defines it."""
    names = {one.name: kind for kind in _TABLES for one in fields(kind)}
    known = [name for name in names if name not in _FROM_LIGHT]
    parts: dict[type, dict[str, Any]] = {kind: {} for kind in _TABLES}
    for name, value in table.items():
        if name not in known:
            at = f"{place}.{name}" if place else name
            why = ": the light of the study decides it" if name in _FROM_LIGHT else ""
            raise StudyError(f"{file}: {at}: unknown{why}; {nearest(name, known)}")
        number = name == "bus" and type(value) in (int, float)  # million events per second
        parts[names[name]][name] = str(value) if number else value
    return (
        read_typed(_Body, parts[_Body], file, StudyError, place),
        read_typed(PixelOptions, parts[PixelOptions], file, StudyError, place),
        read_typed(BusOptions, parts[BusOptions], file, StudyError, place),
    )


def _in_file(pixel: PixelOptions, file: Path) -> PixelOptions:
    """Return the options with the path of a profile resolved relative to `file`."""
    if pixel.profile is None or not pixel.profile.endswith(".toml"):
        return pixel
    return replace(pixel, profile=str(file.parent / pixel.profile))


def _plain(body: _Body) -> SensorModel:
    if (body.sensor is None) == (body.width is None) or (
        body.height is not None and body.width is None
    ):
        found = [name for name in ("sensor", "width", "height") if getattr(body, name) is not None]
        raise TaskError(
            f"found {' and '.join(found) or 'no size'}, expected sensor = NAME, as in "
            "`eres sensors`, or width and height in px"
        )
    if body.sensor is not None:
        return find_grid(body.sensor).model()
    assert body.width is not None, "checked above"
    height = body.width if body.height is None else body.height
    return SensorModel(width=body.width, height=height)


def _lit(plain: SensorModel, body: _Body, pixel: PixelOptions, light: Light) -> SensorModel:
    """Return a sensor in one light, for a white level of 1."""
    if light.illuminance_lux:
        pixel = replace(pixel, illuminance=light.illuminance_lux)
    else:
        pixel = pixel.at_cutoff(light.cutoff_hz)
    model = pixel.applied_to(plain, white_level=1.0)
    if body.threshold is None:
        return model
    return replace(
        model,
        contrast_threshold=body.threshold,
        contrast_threshold_off=pixel.threshold_off,
    )
