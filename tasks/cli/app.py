"""From functions to commands: tyro reads their parameters and docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.conf import Positional, arg
from tyro.extras import SubcommandApp

RunFolder = Annotated[Positional[Path], arg(metavar="RUN", help="folder of a run")]


def commands(functions: Iterable[Callable[..., Any]], *, overview: bool) -> SubcommandApp:
    """Make functions commands of their names.

    Parameters
    ----------
    overview
        Whether the help says the first line of each alone, as in a list of them.
    """
    app = tyro.extras.SubcommandApp()
    for function in functions:
        # tyro keeps the line breaks within what is said of an argument; a terminal has its own.
        text = re.sub(r"\n {8}(?=\S)", " ", inspect.cleandoc(function.__doc__ or ""))
        function.__doc__ = text
        app.command(help=text.partition("\n")[0] if overview else None)(function)
    return app
