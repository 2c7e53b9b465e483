"""Options of commands that simulate a camera: which one, its light, one for each key."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, make_dataclass
from typing import Annotated, Any, Literal, TypeVar

from tyro.conf import arg

from sensor import EventCamera
from sensor.cameras.camera import KEYS
from sensor.cameras.fields import Key
from sensor.cameras.files import camera_of
from tasks.errors import TaskError

_Options = TypeVar("_Options", bound=type)

# Keys without an option of their own: `resolution` is that of the grid, `lux` that of the light.
_NO_OPTION = "width", "height", "illuminance"


def _type(name: str, key: Key) -> Any:
    """Return the type of a key's option, with its help."""
    unit = next(iter(key.units)).removesuffix("1") if key.kind is float else ""
    words = ", ".join(filter(None, (key.meaning, unit)))
    usual = str(key.default).removesuffix(".0")
    usual = "" if usual in ("None", "False", "0", "inf") else f"{usual} by default"
    told = arg(help=f"{'; '.join(filter(None, (words, key.note, usual)))}.")
    if name == "bus":
        return Annotated[float | str | None, told, arg(metavar="FLOAT|CAMERA|unlimited")]
    if key.kind is bool:
        return Annotated[bool, told]
    return Annotated[(Literal[key.words] if key.words else key.kind) | None, told]


def _with_keys(options: _Options) -> _Options:
    """Return the options with one more for each key of a camera."""
    more = [
        (name, _type(name, key), field(default=False if key.kind is bool else None))
        for name, key in KEYS.items()
        if key.part != "name" and name not in _NO_OPTION
    ]
    namespace = {"__doc__": options.__doc__, "__module__": options.__module__}
    return make_dataclass(  # type: ignore[return-value]
        options.__name__, more, bases=(options,), namespace=namespace, frozen=True, kw_only=True
    )


@_with_keys
@dataclass(frozen=True, kw_only=True)
class CameraOptions:
    """What options do not say is that of --electronics, or else of --sensor.

    Parameters
    ----------
    sensor
        Camera: a name (`eres sensors` lists them), or a TOML file.
    resolution
        Width of a plain sensor, px; its height follows that of the frames.
    electronics
        Camera, a name or a file, whose pixels and bus this one has on its own grid; ideal, for
        pixels without delay and noise.
    lux
        Light on the scene, lux, which decides cutoff and shot noise.
    """

    sensor: str | None = None
    resolution: int | None = None
    electronics: str | None = None
    lux: float | None = None

    @property
    def given(self) -> dict[str, Any]:
        """The options that were given, by name."""
        values = asdict(self).items()
        return {name: value for name, value in values if value is not None and value is not False}

    @property
    def light(self) -> dict[str, Any]:
        """The light, as arguments of `EventCamera.model` and others."""
        return {"lux": self.lux, "cutoff_hz": self.given.get("cutoff")}

    def camera(self, width: int, height: int, *, usual_width: int | None = None) -> EventCamera:
        """Return the camera for frames of this size; an option for its cutoff is in `light`.

        Parameters
        ----------
        width, height
            Size of the frames, px.
        usual_width
            Width of the sensor if none is given, px; None to refuse that.

        Returns
        -------
        EventCamera

        Raises
        ------
        TaskError
            Options contradict each other, or one is missing.
        SensorError
            There is no such camera, or a value is wrong.
        """
        given = self.given
        if {"lux", "cutoff"} <= {*given}:
            raise TaskError("give --lux or --cutoff, not both")
        words = {"sensor": "base"} | {name: name for name in ("electronics", *KEYS)}
        camera = camera_of({words[k]: given[k] for k in given if k in words and k != "cutoff"})
        if camera.width is not None:
            if self.resolution is not None:
                raise TaskError(
                    f"give --sensor or --resolution, not both; --resolution {self.resolution} "
                    f"--electronics {self.sensor} puts its pixels on another grid"
                )
            return camera
        columns = usual_width if self.resolution is None else self.resolution
        if columns is None:
            raise TaskError(
                "the sensor has no size; give --sensor NAME (`eres sensors` lists names), a file "
                "with width and height, or --resolution WIDTH"
            )
        return camera.on(columns, max(1, round(columns * height / width)))


NO_OPTIONS = CameraOptions()
