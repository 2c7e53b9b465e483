"""Methods: one file or folder each, listed by task in `tasks.registry`."""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, get_type_hints

from eres_render.errors import suggestion
from eres_render.storage.checksums import sha256
from sensor.own_modules import import_own
from tasks.errors import TaskError
from tasks.methods.networks import digest_of, network, weights_of
from tasks.registry import TASKS, load

_imported: dict[str, tuple[object, str]] = {}  # spec of the module and digest of the user's code


def load_method(
    task: str, name: str, weights: Mapping[str, str] | None = None
) -> Callable[..., Any]:
    """Import a method, and load its network if it has one.

    Parameters
    ----------
    task
        Name of the task.
    name
        Name of the method in `TASKS[task].methods`, or "package.module:function".
    weights
        Files of weights by the names of the methods that need them.

    Returns
    -------
    The method: a function or, for video, a class.

    Raises
    ------
    TaskError
        The task has no method of that name, or the function cannot be imported.
    WeightsError
        The method needs weights, and there are none, or they are from another network.

    Examples
    --------
    >>> from tasks.methods import load_method
    >>> load_method("flow", "photometric_flow").__module__
    'tasks.methods.photometric_flow'
    """
    listed = TASKS[task].methods
    if ":" not in name and name not in listed:
        raise TaskError(
            f"{task}: no method {name!r}; {suggestion(name, listed)} "
            "(for your own method, give package.module:function)"
        )
    module, _, function = TASKS[task].method(name).place.partition(":")
    import_module = importlib.import_module if name in listed else import_own
    try:
        method = getattr(import_module(module), function, None)
    except Exception as error:  # a user's module may raise anything
        kind = "" if isinstance(error, ImportError) else f"{type(error).__name__}: "
        raise TaskError(f"{task}, method {name!r}: cannot be imported: {kind}{error}") from error
    if not callable(method):
        raise TaskError(f"{task}, method {name!r}: found no function {function!r} in {module}")
    if name in TASKS[task].networks:
        method = partial(method, network=network(task, name, weights))
    return method


def task_of(name: str) -> str:
    """Return the task of a method.

    A user's class, "package.module:class", is a video method; the task of a user's function follows
    from the type of its first parameter.

    Raises
    ------
    TaskError
        No task or several tasks have a method of that name, or the type of the first parameter
        belongs to no task.
    """
    if ":" not in name:
        tasks = [task for task in TASKS if name in TASKS[task].methods]
        if len(tasks) == 1:
            return tasks[0]
        known = dict.fromkeys(method for spec in TASKS.values() for method in spec.methods)
        several = f"method {name!r} belongs to several tasks: {', '.join(tasks)}"
        raise TaskError(several if tasks else f"no method {name!r}; {suggestion(name, known)}")
    function = load_method(next(iter(TASKS)), name)
    if not (told := _told_tasks(function)):
        expected = ", ".join(sample.__name__ for sample in _samples().values())
        raise TaskError(
            f"method {name!r}: found {_first_type(function)} as the type of its first parameter, "
            f"expected one of {expected}; the type determines the task"
        )
    return told[0]


def check_method(
    task: str,
    name: str,
    weights: Mapping[str, str] | None = None,
    sizes: Iterable[tuple[int, int]] = (),
) -> None:
    """Check that a method exists, is for a task, and can run.

    Parameters
    ----------
    task
        Name of the task.
    name
        Name of the method in `TASKS[task].methods`, or "package.module:function".
    weights
        Files of weights by the names of the methods that need them.
    sizes
        Widths and heights of the sensors, px.

    Raises
    ------
    TaskError
        The task has no such method, or the method's type is that of another task.
    WeightsError
        Its network has no weights or wrong ones, or cannot run on one of the sensors.
    """
    function = load_method(task, name, weights)
    if name in TASKS[task].networks:
        for size in {*sizes}:
            network(task, name, weights).check_size(*size)
    told = _told_tasks(function) if TASKS[task].is_own(name) else []
    if told and task not in told:
        kind, expected = (
            f"a function of a {_samples()[each].__name__}" if TASKS[each].sample else "a class"
            for each in (told[0], task)
        )
        raise TaskError(
            f"{task}, method {name!r}: found {kind}, which is for {told[0]}, expected {expected}"
        )


def _samples() -> dict[str, type]:
    """Return the class of the first argument of each task's methods, by task, if there is one."""
    return {task: load(spec.sample) for task, spec in TASKS.items() if spec.sample}


def _told_tasks(function: Callable[..., Any]) -> list[str]:
    """Return the tasks that fit the type of a method, none if its type fits no task."""
    if inspect.isclass(function):
        return [task for task, spec in TASKS.items() if spec.sample is None]
    kind = _first_type(function)
    return [task for task, sample in _samples().items() if kind is sample]


def _first_type(function: Callable[..., Any]) -> Any:
    """Return the type of a function's first parameter, None if it is unknown."""
    try:
        first = next(iter(inspect.signature(function).parameters), "")
        return get_type_hints(function).get(first)
    except Exception:  # a user's annotations may raise anything
        return None


def source_file(task: str, name: str) -> str | None:
    """Return the file of a method.

    Parameters
    ----------
    task
        Name of the task.
    name
        Name of the method in `TASKS[task].methods`, or "package.module:function".

    Returns
    -------
    Path of the module that names the function, None if it is not loaded from a file.
    """
    module = sys.modules.get(TASKS[task].method(name).place.partition(":")[0])
    return getattr(module, "__file__", None)


def _files_of(own: str) -> list[Path]:
    """Return the file of the module that a user's method is named by, and that of its code."""
    named, _, function = own.partition(":")
    module = import_own(named)
    method = getattr(module, function, None)
    files: dict[str | None, None] = {}
    for part in (module, inspect.unwrap(method) if callable(method) else module):
        with suppress(TypeError):  # has no source
            files[inspect.getsourcefile(part)] = None
    # Modules of Python itself may have none.
    return [Path(file) for file in files if file and Path(file).is_file()]


def _digest_of_own(place: str) -> str:
    """Return the SHA-256 of the files of a user's code; refuse files that differ from what runs."""
    digest = " ".join(sha256(file) for file in _files_of(place))
    spec = import_own(place.partition(":")[0]).__spec__  # another one after a reload
    if place not in _imported or _imported[place][0] is not spec:
        _imported[place] = spec, digest
    if _imported[place][1] != digest:
        raise TaskError(f"{place}: its files have changed since its import; restart this process")
    return digest


def code_of_tasks(methods: Mapping[str, Iterable[str]]) -> dict[str, str]:
    """Identify the code of a user's own tasks, to detect changes.

    Parameters
    ----------
    methods
        Names of the methods that each task runs, by the task.

    Returns
    -------
    SHA-256 of the files of scorer, settings, and methods that the task lists, by place, without
    those that are part of eres.
    """
    places = []
    for task, names in methods.items():
        spec = TASKS[task]
        listed = [spec.method(name).place for name in names if name in spec.methods]
        places += [spec.scorer, spec.settings, *listed]
    return {place: _digest_of_own(place) for place in places if not place.startswith("tasks.")}


def versions() -> dict[str, int]:
    """Return the numbers of our methods by name, without those of 1."""
    listed = [(name, spec.method(name).version) for spec in TASKS.values() for name in spec.methods]
    return dict(sorted(entry for entry in listed if entry[1] > 1))  # of equal names, the highest


def code_of(names: Iterable[str], weights: Mapping[str, str] | None = None) -> dict[str, str]:
    """Identify the code of methods, and the weights of their networks, to detect changes.

    Our methods have a number, the `version` of their `MethodSpec`. A user's method is identified by
    the SHA-256 of the file that its name gives and, if another file defines it, of that file.
    Weights are identified by the SHA-256 of their file.

    Parameters
    ----------
    names
        Names of the methods.
    weights
        Files of weights by the names of methods, in place of those that come with eres.

    Returns
    -------
    Number or digest by the method's name; methods with number 1 and no weights are left out.
    """
    code, numbers = {}, versions()
    for name in names:
        if ":" in name:
            code[name] = _digest_of_own(name)
        elif name in numbers:
            code[name] = str(numbers[name])
        if file := weights_of(name, weights):
            code[name] = f"{numbers.get(name, 1)} {digest_of(file)}"
    return code
