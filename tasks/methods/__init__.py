"""Methods: one file each, listed by task in `tasks.registry`."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, get_type_hints

from eres_render.errors import nearest
from tasks.errors import TaskError
from tasks.registry import TASKS, load

METHODS = {task: spec.methods for task, spec in TASKS.items()}
"""Where each method is, "module:function", by task and by the method's name."""

# Raise a method's number, 1 where it is not listed, when its results change: studies compute the
# parts that use it again.
METHOD_VERSIONS = {
    "photometric_flow": 2,
    "photometric_flow_unknown_contrast": 2,
    "photometric_flow_with_delay": 2,
}


def load_method(task: str, name: str) -> Callable[..., Any]:
    """Return a method's function, by its name in `METHODS` or as "package.module:function".

    Raises
    ------
    TaskError
        The task has no method of that name (the text gives the nearest one), or there is no such
        function to import.
    """
    listed = TASKS[task].methods
    if ":" not in name and name not in listed:
        raise TaskError(
            f"{task}: no method {name!r}, {nearest(name, listed)} "
            "(name a method of your own package.module:function)"
        )
    module, _, function = listed.get(name, name).partition(":")
    import_module = importlib.import_module if name in listed else _imported
    try:
        found = getattr(import_module(module), function, None)
    except Exception as error:  # whatever a module of the user's does when it is imported
        said = str(error) if isinstance(error, ImportError) else f"{type(error).__name__}: {error}"
        raise TaskError(f"{task}, method {name!r}: cannot be imported: {said}") from error
    if not callable(found):
        raise TaskError(f"{task}, method {name!r}: found no function {function!r} in {module}")
    return found


def task_of(name: str) -> str:
    """Return the task that a method of one's own is for.

    Video reconstruction takes a class; the others take a function, and the type of its first
    parameter tells which.

    Raises
    ------
    TaskError
        It cannot be told.
    """
    function = load_method(next(iter(TASKS)), name)
    told = _told_task(function)
    if told is None:
        expected = ", ".join(sample.__name__ for sample in _samples().values())
        raise TaskError(
            f"method {name!r}: found {_first_type(function)} as the type of its first parameter, "
            f"expected one of {expected}, which tells the task"
        )
    return told


def check_method(task: str, name: str) -> None:
    """Raise a TaskError if a task has no such method, or it says that it is another task's."""
    function = load_method(task, name)
    told = _told_task(function) if ":" in name else None
    if told not in (task, None):
        found, expected = (
            f"a function of a {_samples()[one].__name__}" if TASKS[one].sample else "a class"
            for one in (told, task)
        )
        raise TaskError(
            f"{task}, method {name!r}: found {found}, which is for {told}, expected {expected}"
        )


def _samples() -> dict[str, type]:
    """What a method of each task takes first, where it takes something."""
    return {task: load(spec.sample) for task, spec in TASKS.items() if spec.sample}


def _told_task(function: Callable[..., Any]) -> str | None:
    """The task that a method says it is for, or None where it does not."""
    if inspect.isclass(function):
        return next(task for task, spec in TASKS.items() if spec.sample is None)
    kind = _first_type(function)
    return next((task for task, sample in _samples().items() if kind is sample), None)


def _first_type(function: Callable[..., Any]) -> Any:
    """The type of a function's first parameter, None where it has none or is not to be had."""
    try:
        first = next(iter(inspect.signature(function).parameters), "")
        return get_type_hints(function).get(first)
    except Exception:  # annotations are the user's code too
        return None


def source_file(task: str, name: str) -> str | None:
    """The file that a method's function was named to be in, if its module is loaded from one."""
    module = sys.modules.get(TASKS[task].methods.get(name, name).partition(":")[0])
    return getattr(module, "__file__", None)


def code_of(names: Iterable[str]) -> dict[str, str]:
    """What tells a method's code from what it was when rows were made, by the method's name.

    Of ours it is the number in `METHOD_VERSIONS`. Others can change with any edit, so of them it is
    the SHA-256 of their file.
    """
    found = {}
    for name in names:
        if ":" in name:
            file = inspect.getsourcefile(_imported(name.partition(":")[0]))
            found[name] = hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""
        elif name in METHOD_VERSIONS:
            found[name] = str(METHOD_VERSIONS[name])
    return found


def _imported(module: str) -> ModuleType:
    """Import a module of the user's, also from the working directory, as `python -m` would."""
    if "" not in sys.path and os.getcwd() not in sys.path:
        sys.path.insert(0, os.getcwd())
    return importlib.import_module(module)
