"""`Header`: what a file says besides its events, and its form as JSON."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field

from sensor.errors import EventFormatError, SensorError
from sensor.model import MAX_SIDE_PX, SensorModel

Value = str | int | float
_KEY = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Header:
    """What a file says besides its events.

    Parameters
    ----------
    width, height
        The sensor's size in pixels; None where the file does not store it.
    model
        The sensor that made the events; None for recordings and where it is not stored.
    origin
        Whatever else says how the events were made: seed, speed, sequence. Names are lower-case
        words joined by underscores; values are strings, integers or finite floats.
    t_offset_us
        Where the file's own clock starts, microseconds on that of the events, if it says so.
    others
        Names of what else the file holds: data, attributes, header lines. They are not read.

    Raises
    ------
    EventFormatError
        The size or an entry of `origin` is not of that form; the text names it.
    """

    width: int | None
    height: int | None
    model: SensorModel | None = None
    origin: Mapping[str, Value] = field(default_factory=dict)
    t_offset_us: int = 0
    others: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            side = getattr(self, name)
            if side is not None and not 1 <= side <= MAX_SIDE_PX:
                raise EventFormatError(
                    f"{name}: found {side}, expected a sensor's side in 1..{MAX_SIDE_PX} px"
                )
        for name, value in self.origin.items():
            right = isinstance(value, Value) and not isinstance(value, bool)
            if isinstance(value, float) and not math.isfinite(value):
                right = False
            if not (isinstance(name, str) and _KEY.fullmatch(name) and right):
                raise EventFormatError(
                    f"origin: found {name!r}: {value!r}, expected a lower-case name and a string, "
                    "an integer or a finite number"
                )

    def with_size(self, size: tuple[int, int] | None) -> Header:
        """The same with a size given by the user, for files that do not store it.

        Raises
        ------
        EventFormatError
            Neither the file nor the user says it, or they contradict each other.
        """
        if self.width is None or self.height is None:
            if size is None:
                raise EventFormatError(
                    "the file does not store the sensor's size; give it (size=(width, height), "
                    "--size WIDTH HEIGHT)"
                )
            return dataclasses.replace(self, width=size[0], height=size[1])
        if size is not None and tuple(size) != (self.width, self.height):
            raise EventFormatError(
                f"found a size of {self.width}x{self.height}, expected {size[0]}x{size[1]} as given"
            )
        return self


def model_to_json(model: SensorModel) -> str:
    """A model as one line of JSON; infinity is the string "inf", which JSON has no number for."""
    table = {
        name: "inf" if value == math.inf else value
        for name, value in dataclasses.asdict(model).items()
    }
    return json.dumps(table)


def model_from_json(text: str) -> SensorModel:
    """A model from `model_to_json`'s line; parameters that it does not name have their defaults.

    Raises
    ------
    EventFormatError
        It is not JSON, names a parameter that `SensorModel` does not have, or has a value that is
        none.
    """
    table = _table(text, "sensor_model")
    kinds = typing.get_type_hints(SensorModel)
    for name, value in table.items():
        if name not in kinds:
            raise EventFormatError(
                f"sensor_model.{name}: unknown parameter; a newer version may have written it"
            )
        allowed = typing.get_args(kinds[name]) or (kinds[name],)
        if value == "inf" and float in allowed:
            table[name] = math.inf
        elif type(value) is int and float in allowed:
            table[name] = float(value)
        elif type(value) not in allowed:
            raise EventFormatError(f"sensor_model.{name}: found {value!r}")
    try:
        return SensorModel(**table)
    except (SensorError, TypeError) as error:
        raise EventFormatError(f"sensor_model: {error}") from error


def origin_to_json(origin: Mapping[str, Value]) -> str:
    """An origin as one line of JSON."""
    return json.dumps(dict(origin))


def origin_from_json(text: str) -> dict[str, Value]:
    """An origin from `origin_to_json`'s line, its entries not checked yet.

    Raises
    ------
    EventFormatError
        It is not a JSON object.
    """
    return _table(text, "origin")


def _table(text: str, name: str) -> dict[str, typing.Any]:
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise EventFormatError(f"{name}: found {text[:60]!r}, which is not JSON") from error
    if not isinstance(table, dict):
        raise EventFormatError(f"{name}: found {text[:60]!r}, expected a JSON object")
    return table
