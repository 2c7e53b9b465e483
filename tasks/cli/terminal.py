"""Consoles of the command line: `out` prints results to stdout, `err` the rest to stderr.

They print brackets and colons as they are: names of files may have them. Colors are `Text`. Control
characters, of which names and files may be made, are printed as escapes.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from typing import Any

import rich.console
from rich.segment import Segment
from rich.text import Text

from eres_render.progress import Progress
from tasks.cli.table import Table

# All but line feeds and tabs: C0, C1, marks of direction, other ends of lines, lone surrogates.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def escaped(text: str) -> str:
    """Return a text whose control characters are escapes, as in Python's literals."""
    return _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode(), text)


class Console(rich.console.Console):
    """A console that shows text as it is, without control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As `Console.render_str`, with room for the escapes."""
        return super().render_str(escaped(text), **options)

    def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
        """As `Console.render`; segments with controls are Rich's own."""
        for part in super().render(renderable, options):
            yield part if part.control else part._replace(text=escaped(part.text))


out = Console()
err = Console(stderr=True)


def say(*lines: str | Text) -> None:
    """Print lines to stdout, without line breaks of ours."""
    for line in lines:
        out.print(line, soft_wrap=True, highlight=False)


def show(table: Table) -> None:
    """Print a table to stdout; lines may be longer than the screen."""
    out.print(table, crop=False)


def show_pairs(pairs: Mapping[str, str]) -> None:
    """Print the pairs that have a value as a table."""
    table = Table(box=None, show_header=False)
    for name, value in pairs.items():
        if value:
            table.add_row(name, value)
    show(table)


def show_json(value: object) -> None:
    """Print a value as JSON to stdout."""
    from eres_render.storage.json_values import json_values

    print(json.dumps(json_values(value), indent=1))


def progress() -> AbstractContextManager[Progress]:
    """Show progress on stderr."""
    from tasks.cli.progress_bar import progress_bar

    return progress_bar(err)
