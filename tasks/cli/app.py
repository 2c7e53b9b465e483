"""Commands made of functions: tyro reads their parameters and docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import docstring_parser
from tyro.conf import Positional, arg
from tyro.extras import SubcommandApp

RunFolder = Annotated[Positional[Path], arg(metavar="RUN", help="folder of a run")]
OtherRuns = Annotated[Positional[tuple[Path, ...]], arg(metavar="[RUN...]", help_behavior_hint="")]
WeightsFiles = Annotated[tuple[str, ...], arg(metavar="[METHOD=]FILE...", help_behavior_hint="")]


def commands(functions: Iterable[Callable[..., Any]], *, overview: bool) -> SubcommandApp:
    """Make commands of functions, with their names.

    Parameters
    ----------
    functions
        The functions; tyro reads their parameters and docstrings.
    overview
        Whether each command's help is only its first line, for the list of all commands.

    Returns
    -------
    The application.
    """
    app = SubcommandApp()
    for function in functions:
        first_line = _prepare(function)
        app.command(help=first_line if overview else None)(function)
    return app


@cache
def _prepare(function: Callable[..., Any]) -> str | None:
    """Change the docstring and annotations of a command to what tyro shows well.

    Returns
    -------
    The first line of its docstring.
    """
    described = docstring_parser.parse(function.__doc__ or "")
    for argument in described.params:  # tyro would keep the source's line breaks
        argument.description = " ".join((argument.description or "").split())
        argument.default = None  # parsed from "by default ..."; compose adds it to the name
    function.__doc__ = docstring_parser.compose(described)
    _hide_unset(function)
    return described.short_description


@cache  # commands share options, and each change would add to the one before
def _hide_unset(function: Callable[..., Any]) -> None:
    """Hide the defaults None and False, which tyro would print after the help of an option.

    Hints that an option already has stay.

    Parameters
    ----------
    function
        A command, or a dataclass of options; its annotations change.
    """
    plain, whole = get_type_hints(function), get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        if is_dataclass(plain[name]):
            _hide_unset(plain[name])
        elif parameter.default is None or parameter.default is False:
            own = get_args(whole[name])[1:] if get_origin(whole[name]) is Annotated else ()
            parts = plain[name], arg(help_behavior_hint=""), *own  # the last hint counts
            function.__annotations__[name] = Annotated[parts]
