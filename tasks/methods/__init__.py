"""Methods: one file each, listed in `METHODS` by where to find their function."""

from __future__ import annotations

import difflib
import importlib
from collections.abc import Callable
from typing import Any

from tasks.errors import TaskError

# By task, then by the method's name: "module:function". Strings, so that listing imports nothing.
METHODS = {
    "reconstruction": {
        "event_integration": "tasks.methods.event_integration:reconstruct",
        "no_events": "tasks.methods.no_events:reconstruct",
    },
    "flow": {
        "photometric_flow": "tasks.methods.photometric_flow:estimate",
        "contrast_maximization": "tasks.methods.contrast_maximization:estimate",
        "initial_flow": "tasks.methods.initial_flow:estimate",
    },
}


def load_method(task: str, name: str) -> Callable[..., Any]:
    """Return a method's function.

    Raises
    ------
    TaskError
        The task has no method of that name; the text gives the nearest one.
    """
    listed = METHODS[task]
    if name not in listed:
        near = difflib.get_close_matches(name, listed, n=1) or sorted(listed)
        raise TaskError(f"{task}: no method {name!r}; did you mean {near[0]!r}?")
    module, function = listed[name].split(":")
    return getattr(importlib.import_module(module), function)
