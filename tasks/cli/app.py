"""Commands made of functions: tyro reads their parameters and docstrings."""

from __future__ import annotations

import inspect
import shutil
import textwrap
from collections.abc import Callable, Collection, Iterable, Sized
from dataclasses import is_dataclass
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import docstring_parser
from tyro.conf import Positional, arg
from tyro.extras import SubcommandApp

from tasks.errors import UsageError

RunFolder = Annotated[Positional[Path], arg(metavar="RUN", help="folder of a run")]
ScenePath = Annotated[
    Positional[str], arg(metavar="SCENE", help="name or folder of a scene, or a Mitsuba .xml")
]
SequenceFolder = Annotated[
    Positional[Path], arg(metavar="SEQUENCE", help="folder of a clip or continuous sequence")
]
OtherRuns = Annotated[Positional[tuple[Path, ...]], arg(metavar="[RUN...]", help_behavior_hint="")]
AsJson = Annotated[bool, arg(name="json", help="Print JSON, for programs.")]
WeightsFiles = Annotated[tuple[str, ...], arg(metavar="[METHOD=]FILE...", help_behavior_hint="")]


def several(metavar: str, help: str) -> Any:
    """Return the hint of a positional argument of which there are several; see `require`."""
    return arg(metavar=metavar, help=help, help_behavior_hint="(required)")


def require(values: Sized, what: str) -> None:
    """Refuse a positional argument of which none is given."""
    if not values:
        raise UsageError(f"give at least one {what}")


def commands(functions: Iterable[Callable[..., Any]], given: Collection[str]) -> SubcommandApp:
    """Make commands of functions, with their names.

    Only the one that is `given`, if one is: each costs time. In a list of all, the help of each is
    its first line.
    """
    app = SubcommandApp()
    every = [*functions]
    chosen = [function for function in every if function.__name__ in given]
    for function in chosen or every:
        text = _prepare(function)
        app.command(help=wrapped(text) if chosen else text.partition("\n")[0])(function)
    return app


class _Verbatim(str):
    """A text whose line breaks stay: tyro joins the lines that `split` returns."""

    def split(self, *_: Any) -> list[str]:
        return [str(self)]


def wrapped(text: str) -> str:
    """Return paragraphs that are wrapped to the terminal, for the top of a help."""
    width = shutil.get_terminal_size().columns
    fill = partial(textwrap.fill, width=width, break_on_hyphens=False, break_long_words=False)
    return _Verbatim("\n\n".join(map(fill, text.split("\n\n"))))


@cache
def _prepare(function: Callable[..., Any]) -> str:
    """Change the docstring and annotations of a command to what tyro shows well.

    Returns
    -------
    Its description.
    """
    described = docstring_parser.parse(function.__doc__ or "")
    for argument in described.params:  # tyro would keep the source's line breaks
        argument.description = " ".join((argument.description or "").split())
        argument.default = None  # parsed from "by default ..."; compose adds it to the name
    function.__doc__ = docstring_parser.compose(described)
    _hide_unset(function)
    return described.description or ""


@cache  # commands share options, and each change would add to the one before
def _hide_unset(function: Callable[..., Any]) -> None:
    """Hide the defaults None and False, which tyro would print after the help of an option.

    Changes the annotations of a command or a dataclass of options. Hints that an option already has
    stay.
    """
    plain, whole = get_type_hints(function), get_type_hints(function, include_extras=True)
    for name, parameter in inspect.signature(function).parameters.items():
        if is_dataclass(plain[name]):
            _hide_unset(plain[name])
        elif parameter.default is None or parameter.default is False:
            own = getattr(whole[name], "__metadata__", ())  # of `Annotated`
            parts = plain[name], arg(help_behavior_hint=""), *own  # the last hint counts
            function.__annotations__[name] = Annotated[parts]
