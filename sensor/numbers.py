"""Check numbers from users: Python or NumPy numbers, but no bool, string or NaN."""

from __future__ import annotations

import math
import sys

import numpy as np

from sensor.errors import SensorError

_MAX_TEXT = 60  # characters of a value in an error message


POSITIVE, FINITE = math.ulp(0.0), sys.float_info.max
"""The smallest and the largest finite positive number."""


def real(
    name: str, value: object, expected: str, low: float = -math.inf, high: float = math.inf
) -> float:
    """Return a number from `low` to `high` as a Python float."""
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # an integer beyond all floats
            number = math.nan
        if low <= number <= high:  # not NaN
            return number
    raise refusal(name, value, expected)


def whole(
    name: str, value: object, expected: str, low: float = -math.inf, high: float = math.inf
) -> int:
    """Return an integer from `low` to `high` as a Python int."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        number = int(value)
        if low <= number <= high:
            return number
    raise refusal(name, value, expected)


def refusal(name: str, value: object, expected: str) -> SensorError:
    """Return the error for a wrong value, one line of text."""
    text = repr(value)
    if len(text) > _MAX_TEXT or "\n" in text:
        text = f"a value of type {type(value).__name__}"
    return SensorError(f"{name}: found {text}, expected {expected}")
