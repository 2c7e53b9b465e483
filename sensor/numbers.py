"""Numbers that users give: Python's or NumPy's, and neither a bool, nor a string, nor NaN."""

from __future__ import annotations

import math

import numpy as np

from sensor.errors import SensorError

_LONGEST = 60  # characters of a value that an error line has room for


def real(name: str, value: object, expected: str) -> float:
    """A number as Python's float; infinity is one.

    Parameters
    ----------
    name, expected
        What an error calls the value, and what it says should have been there.

    Raises
    ------
    SensorError
        The value is no number, or NaN.
    """
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # an integer beyond all floats
            number = math.nan
        if not math.isnan(number):
            return number
    raise refusal(name, value, expected)


def whole(name: str, value: object, expected: str) -> int:
    """An integer as Python's int; parameters and errors as for `real`."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return int(value)
    raise refusal(name, value, expected)


def refusal(name: str, value: object, expected: str) -> SensorError:
    """The error for a value that is not what was expected, in one line."""
    text = repr(value)
    if len(text) > _LONGEST or "\n" in text:
        text = f"a value of type {type(value).__name__}"
    return SensorError(f"{name}: found {text}, expected {expected}")
