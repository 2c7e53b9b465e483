"""Settings as values for JSON, which `eres_render.storage.settings_reader` reads."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def use_python_numbers(settings: Any) -> None:
    """Replace NumPy's numbers in a dataclass's fields by Python's, arrays and lists by tuples."""
    for field in fields(settings):
        value = _with_python_numbers(getattr(settings, field.name))
        object.__setattr__(settings, field.name, value)


def _with_python_numbers(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if type(value) in (list, tuple):  # not a NamedTuple
        return tuple(map(_with_python_numbers, value))
    if is_dataclass(value) and not isinstance(value, type):
        use_python_numbers(value)
    return value


def json_values(value: object, optional: Collection[str] = ()) -> Any:
    """Return settings as values for JSON, infinity as "inf", without empty `optional` fields."""
    if is_dataclass(value):
        named = {field.name: getattr(value, field.name) for field in fields(value)}
        value = {name: item for name, item in named.items() if name not in optional or item}
    if isinstance(value, Mapping):
        return {name: json_values(item, optional) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(item, optional) for item in value]
    return "inf" if value == math.inf else value
