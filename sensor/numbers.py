"""Check numbers from users: Python or NumPy numbers, but no bool, string or NaN."""

from __future__ import annotations

import math

import numpy as np

from sensor.errors import SensorError

_LONGEST = 60  # characters of a value in an error message


def real(name: str, value: object, expected: str) -> float:
    """Return a number as a Python float; infinity is allowed."""
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # an integer beyond all floats
            number = math.nan
        if not math.isnan(number):
            return number
    raise refusal(name, value, expected)


def whole(name: str, value: object, expected: str) -> int:
    """Return an integer as a Python int."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return int(value)
    raise refusal(name, value, expected)


def refusal(name: str, value: object, expected: str) -> SensorError:
    """Return the error for a wrong value, one line of text."""
    text = repr(value)
    if len(text) > _LONGEST or "\n" in text:
        text = f"a value of type {type(value).__name__}"
    return SensorError(f"{name}: found {text}, expected {expected}")
