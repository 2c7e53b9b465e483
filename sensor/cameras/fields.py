"""What a key of a camera's file is: its kind, units and range."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

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


_UNITS: dict[str, dict[str, Convert]] = {
    "number": {"1": float},
    "share": {"1": _times(1), "%": _times(1e-2)},
    "log": {"log": _times(1), "%": _times(1e-2)},
    "log of ON": {"log": _times(1), "%": _rise},
    "log of OFF": {"log": _times(1), "%": _fall},
    "Hz": {"Hz": _times(1), "kHz": _times(1e3)},
    "s": {"s": _times(1), "ms": _times(1e-3), "us": _times(1e-6)},
    "px": {"px": float},
    "um": {"um": _times(1)},
    "lux": {"lux": _times(1), "klux": _times(1e3)},
    "events": {"events": float},
    "Mev/s": {"Mev/s": _times(1e6), "ev/s": _times(1)},
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Key:
    """A key of a camera's file.

    Parameters
    ----------
    meaning
        What its value is, in words.
    default
        Its value for a camera that does not state it, in the unit of the field.
    note
        More about it, for the help of its option.
    kind
        "number", "integer", "text", "flag" or "word".
    units
        Units of a number, each with the conversion to the unit of the field, the default first.
    least, most
        Smallest and largest number, in the unit of the field.
    words
        All values of a word.
    part
        "name" for words about the camera, which need no source; "grid" for its size and the area of
        its pixels; "electronics"; or "bus".
    """

    meaning: str
    default: Any
    note: str = ""
    kind: Literal["number", "integer", "text", "flag", "word"] = "number"
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
        if self.kind == "flag":
            if not isinstance(value, bool):
                raise refusal(name, value, "true or false")
            return value
        if self.kind in ("text", "word"):
            if not isinstance(value, str) or (self.words and value not in self.words):
                raise refusal(name, value, " or ".join(map(repr, self.words)) or "a string")
            return value
        read, words = (whole, "an integer") if self.kind == "integer" else (real, "a number")
        expected = f"{words} from {self.least:g} to {self.most:g}"
        return read(name, value, expected, self.least, self.most)


def in_file(
    default: Any, meaning: str, *, key: str = "", unit: str = "number", **facts: Any
) -> Any:
    """Return a dataclass field with its key in files, which has the field's name by default."""
    described = Key(meaning=meaning, default=default, units=_UNITS[unit], **facts)
    return field(default=default, metadata={"name": key, "key": described})
