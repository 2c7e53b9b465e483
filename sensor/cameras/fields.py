"""What a key of a camera's file is: its kind, units and range."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from inspect import cleandoc
from typing import Any, Literal, get_args, get_type_hints

from sensor.model import BOUNDS
from sensor.numbers import real, refusal, whole

Convert = Callable[[float], float]


def _times(factor: float) -> Convert:
    return lambda value: factor * value


def _rise(percent: float) -> float:
    """Convert a contrast of brighter light to log units."""
    return math.log1p(percent / 100)


def _fall(percent: float) -> float:
    """Convert a contrast of darker light to log units."""
    return -math.log1p(-percent / 100) if percent < 100 else math.inf


# Those with several names; any other is its own.
_UNITS: dict[str, dict[str, Convert]] = {
    "share": {"1": _times(1), "%": _times(1e-2)},
    "log": {"log": _times(1), "%": _times(1e-2)},
    "log of ON": {"log": _times(1), "%": _rise},
    "log of OFF": {"log": _times(1), "%": _fall},
    "Hz": {"Hz": _times(1), "kHz": _times(1e3)},
    "s": {"s": _times(1), "ms": _times(1e-3), "us": _times(1e-6)},
    "lux": {"lux": _times(1), "klux": _times(1e3)},
    "Mev/s": {"Mev/s": _times(1e6), "ev/s": _times(1)},
}
_SUFFIXES = {"hz": "Hz", "s": "s", "um": "um", "lux": "lux"}  # of fields


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """A key of a camera's file.

    Parameters
    ----------
    field
        Name of its field in `EventCamera`.
    kind
        float, int, bool or str.
    meaning
        What its value is, in words, from the docstring of the class.
    default
        Its value for a camera that does not state it, in the unit of the field.
    note
        More about it, for the help of its option.
    units
        Units of a number, each with the conversion to the unit of the field, the default first.
    least, most
        Smallest and largest number, in the unit of the field.
    words
        All strings that it can be; none for any.
    part
        "name" for words about the camera, which need no source; "grid" for its size and the area of
        its pixels; "electronics"; or "bus".
    """

    field: str
    kind: type
    meaning: str
    default: Any
    note: str
    units: Mapping[str, Convert]
    least: float = 0.0
    most: float = math.inf
    words: tuple[str, ...] = ()
    part: Literal["name", "grid", "electronics", "bus"] = "electronics"

    def checked(self, name: str, value: Any) -> Any:
        """Return a value as a Python value of its kind.

        Parameters
        ----------
        name
            Name of the key, for errors.
        value
            The value, in the unit of the field.

        Returns
        -------
        bool, str, int or float

        Raises
        ------
        SensorError
            The value is of another kind, or out of range.
        """
        if self.kind in (bool, str):
            if not isinstance(value, self.kind) or (self.words and value not in self.words):
                usual = "true or false" if self.kind is bool else "a string"
                raise refusal(name, value, " or ".join(map(repr, self.words)) or usual)
            return value
        read, words = (whole, "an integer") if self.kind is int else (real, "a number")
        expected = f"{words} from {self.least:g} to {self.most:g}"
        return read(name, value, expected, self.least, self.most)


def in_file(default: Any, unit: str = "", *, key: str = "", **facts: Any) -> Any:
    """Return a dataclass field with a key in files: by default its name, without its unit."""
    return field(default=default, metadata={"key": key, "unit": unit, "facts": facts})


def keys_of(described: type) -> dict[str, Key]:
    """Return the keys of a dataclass, by name; fields of `SensorModel` have its bounds."""
    keys, hints, meanings = {}, get_type_hints(described), _meanings(described)
    for each in (each for each in fields(described) if each.metadata):
        kinds = get_args(hints[each.name]) or (hints[each.name],)
        words = kinds if isinstance(kinds[0], str) else ()
        facts = {"kind": str if words else kinds[0], "words": words} | each.metadata["facts"]
        facts["meaning"], _, facts["note"] = meanings.get(each.name, "").partition("; ")
        if each.name in BOUNDS:
            facts["least"], facts["most"], _ = BOUNDS[each.name]
        name, _, suffix = each.name.rpartition("_")
        unit = each.metadata["unit"] or _SUFFIXES.get(suffix, "1")
        name = each.metadata["key"] or (name if suffix in _SUFFIXES else each.name)
        keys[name] = Key(
            field=each.name, default=each.default, units=_UNITS.get(unit, {unit: float}), **facts
        )
    return keys


def _meanings(described: type) -> dict[str, str]:
    """Return the first sentence of each parameter in the docstring of a class, without its dot."""
    entries = re.findall(
        r"^(\w+)\n((?: {4}.*\n)+)", cleandoc(described.__doc__ or ""), re.MULTILINE
    )
    return {name: re.split(r"\.(?: |$)", " ".join(text.split()))[0] for name, text in entries}
