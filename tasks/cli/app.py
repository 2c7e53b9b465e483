"""Commands made of functions: tyro reads their parameters and docstrings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import docstring_parser
from tyro.conf import Positional, arg
from tyro.extras import SubcommandApp

RunFolder = Annotated[Positional[Path], arg(metavar="RUN", help="folder of a run")]
OtherRuns = Annotated[
    Positional[tuple[Path, ...]],
    arg(metavar="[RUN...]", help_behavior_hint=""),
]
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
        described = docstring_parser.parse(function.__doc__ or "")
        for argument in described.params:  # tyro would keep the source's line breaks
            argument.description = " ".join((argument.description or "").split())
            argument.default = None  # parsed from "by default ..."; compose adds it to the name
        function.__doc__ = docstring_parser.compose(described)
        app.command(help=described.short_description if overview else None)(function)
    return app
