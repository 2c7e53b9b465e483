"""`Header`: the content of an event file except for the events, and its JSON form."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sensor.errors import EventFormatError, reading
from sensor.formats.triggers import NO_TRIGGERS, Triggers
from sensor.model import MAX_SIDE_PX, SensorModel

Value = str | int | float
_KEY = re.compile(r"[a-z][a-z0-9_]*")
_MAX_CHARACTERS = 200_000  # npz stores four bytes for each, and reads up to 1 MiB


@dataclass(frozen=True, slots=True)
class Header:
    """The content of an event file except for the events.

    Parameters
    ----------
    width, height
        Size of the sensor in pixels; None if the file does not store it.
    model
        The simulated sensor; None for recordings and if the file does not store it.
    origin
        Further facts about the events, such as seed, speed and sequence. Names are
        lower-case words joined by underscores; values are strings, integers or finite floats.
    t_offset_us
        Start of the clock of the file, microseconds on the clock of the events.
    others
        Names of data, attributes and header lines in the file that are not read.
    triggers
        External triggers to write. `read_header` leaves them out, since in EVT they lie between the
        events: `read_triggers` reads them.

    Raises
    ------
    EventFormatError
        The size or an entry of `origin` is invalid, or the model has another size; the message
        names the field.

    Examples
    --------
    >>> from sensor.formats import Header
    >>> header = Header(width=None, height=None)  # of a file that does not store the size
    >>> header.with_size((640, 480)).width
    640
    >>> Header(346, 260, origin={"seed": 3, "lens": "8 mm"}).origin["lens"]
    '8 mm'
    """

    width: int | None
    height: int | None
    model: SensorModel | None = None
    origin: Mapping[str, Value] = field(default_factory=dict)
    t_offset_us: int = 0
    others: tuple[str, ...] = ()
    triggers: Triggers = NO_TRIGGERS

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            side, of_model = getattr(self, name), getattr(self.model, name, None)
            if side is None:
                continue
            if not isinstance(side, int | np.integer) or not 1 <= side <= MAX_SIDE_PX:
                raise EventFormatError(
                    f"{name}: found {side!r}, expected an integer in 1..{MAX_SIDE_PX} px"
                )
            if of_model not in (None, side):
                raise EventFormatError(
                    f"sensor_model: has {name} {of_model} px, but the events have {side} px"
                )
        offset_us = self.t_offset_us
        if not isinstance(offset_us, int | np.integer) or not -(2**63) <= offset_us < 2**63:
            raise EventFormatError(
                f"t_offset_us: found {offset_us!r}, expected whole microseconds within int64"
            )
        for name, value in self.origin.items():
            is_value = isinstance(value, str | int) and not isinstance(value, bool)
            is_value |= isinstance(value, float) and math.isfinite(value)
            if not (isinstance(name, str) and _KEY.fullmatch(name) and is_value):
                raise EventFormatError(
                    f"origin: found {name!r}: {value!r}, expected a lower-case name with a string, "
                    "an integer or a finite number"
                )

    @property
    def size(self) -> tuple[int, int]:
        """Return width and height of the sensor, pixels.

        Raises
        ------
        EventFormatError
            The file does not store them; see `with_size`.
        """
        if self.width is None or self.height is None:
            raise EventFormatError(
                "the file does not store the sensor's size; give it (size=(width, height), "
                "--size WIDTH HEIGHT)"
            )
        return self.width, self.height

    def with_size(self, size: tuple[int, int] | None) -> Header:
        """Return the header with a size from the user, for files that do not store it.

        Raises
        ------
        EventFormatError
            There is no size, it is not two numbers, or it differs from the size in the file.
        """
        if size is None:
            _ = self.size
            return self
        if not isinstance(size, tuple | list) or len(size) != 2:
            raise EventFormatError(f"size: found {size!r}, expected (width, height) in px")
        if self.width is None or self.height is None:
            return dataclasses.replace(self, width=size[0], height=size[1])
        if tuple(size) != self.size:
            raise EventFormatError(
                f"size: the file has {self.width}x{self.height} px, not the given "
                f"{size[0]}x{size[1]} px"
            )
        return self


def model_to_json(model: SensorModel) -> str:
    """Convert a model to one line of JSON; infinity becomes the string "inf"."""
    table = dataclasses.asdict(model)
    return json.dumps({name: "inf" if v == math.inf else v for name, v in table.items()})


def model_from_json(text: str) -> SensorModel:
    """Convert the line of `model_to_json` to a model; missing parameters have their defaults."""
    table = _table(text, "sensor_model")
    if table.get("poles") in (1, 2) and "photoreceptor" not in table:  # in older files
        table["photoreceptor"] = "two_pole" if table.pop("poles") == 2 else "one_pole"
    kinds = {**typing.get_type_hints(SensorModel), "photoreceptor": str}
    for name, value in table.items():
        if name not in kinds:
            raise EventFormatError(
                f"sensor_model.{name}: unknown; a newer version of eres may have written it"
            )
        allowed = typing.get_args(kinds[name]) or (kinds[name],)
        if value == "inf" and float in allowed:
            table[name] = math.inf
        elif type(value) not in allowed and not (type(value) is int and float in allowed):
            expected = " or ".join("null" if k is type(None) else k.__name__ for k in allowed)
            raise EventFormatError(f"sensor_model.{name}: found {value!r}, expected {expected}")
    with reading("sensor_model"):
        return SensorModel(**table)


def facts_to_json(header: Header) -> dict[str, str]:
    """Return `origin` and, if there is a model, `sensor_model`, each one line of JSON."""
    texts = {"origin": json.dumps(dict(header.origin))}
    if len(texts["origin"]) > _MAX_CHARACTERS:
        raise EventFormatError(
            f"origin: found {len(texts['origin'])} characters of JSON, expected at most "
            f"{_MAX_CHARACTERS}"
        )
    if header.model is not None:
        texts["sensor_model"] = model_to_json(header.model)
    return texts


def facts_from_json(texts: Mapping[str, str]) -> tuple[SensorModel | None, dict[str, Value]]:
    """Return the model and the origin from the texts of `facts_to_json`; each may be missing."""
    model = model_from_json(texts["sensor_model"]) if "sensor_model" in texts else None
    return model, _table(texts["origin"], "origin") if "origin" in texts else {}


def _table(text: str, name: str) -> dict[str, typing.Any]:
    with reading(f"{name}: found {text[:60]!r}, expected JSON"):
        table = json.loads(text)
    if not isinstance(table, dict):
        raise EventFormatError(f"{name}: found {text[:60]!r}, expected a JSON object")
    return table
