"""Settings as values for JSON, which `eres_render.storage.settings_reader` reads."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def use_python_numbers(settings: Any) -> None:
    """Replace NumPy's numbers in the fields of a dataclass by Python's, and arrays by tuples.

    Parameters
    ----------
    settings
        An instance of a dataclass, which may be frozen.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> from eres_render.storage.json_values import use_python_numbers
    >>> @dataclass(frozen=True)
    ... class Settings:
    ...     width: int
    ...     cutoffs_hz: tuple[float, ...]
    ...     def __post_init__(self):
    ...         use_python_numbers(self)
    >>> Settings(np.int64(64), np.array([50.0, 200.0]))
    Settings(width=64, cutoffs_hz=(50.0, 200.0))
    """
    for one in fields(settings):
        value = getattr(settings, one.name)
        if isinstance(value, np.generic):
            object.__setattr__(settings, one.name, value.item())
        elif isinstance(value, np.ndarray):
            object.__setattr__(settings, one.name, tuple(value.tolist()))
        elif type(value) is tuple:
            plain = (v.item() if isinstance(v, np.generic) else v for v in value)
            object.__setattr__(settings, one.name, tuple(plain))


def json_values(value: object, optional: Collection[str] = ()) -> Any:
    """Return settings as values for JSON.

    Dataclasses become objects, tuples lists, and infinity "inf", as JSON has no such number.

    Parameters
    ----------
    value
        The settings.
    optional
        Names of fields that are left out of dataclasses if they are None or empty.

    Returns
    -------
    values

    Examples
    --------
    >>> import math
    >>> from eres_render.storage.json_values import json_values
    >>> json_values({"width": 64, "cutoffs_hz": (200.0, math.inf)})
    {'width': 64, 'cutoffs_hz': [200.0, 'inf']}
    """
    if is_dataclass(value):
        named = {one.name: getattr(value, one.name) for one in fields(value)}
        value = {name: one for name, one in named.items() if name not in optional or one}
    if isinstance(value, Mapping):
        return {name: json_values(one, optional) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(one, optional) for one in value]
    return "inf" if value == math.inf else value
