"""Consoles of the command line: `out` prints results to stdout, `err` the rest to stderr.

They print brackets and colons as they are: names of files may have them. Colors are `Text`. Control
characters, of which names and files may be made, are printed as escapes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import rich.console
from rich.segment import Segment
from rich.text import Text

# All but line feeds and tabs: C0, C1, marks of direction, other ends of lines, lone surrogates.
_CONTROL = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)


def escaped(text: str) -> str:
    """Return a text whose control characters are escapes, as in Python's literals."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class Console(rich.console.Console):
    """A console that shows text as it is, without control characters."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """As `Console.render_str`, with room for the escapes."""
        return super().render_str(escaped(text), **options)

    def render(
        self,
        renderable: rich.console.RenderableType,
        options: rich.console.ConsoleOptions | None = None,
    ) -> Iterable[Segment]:
        """As `Console.render`; segments with controls are Rich's own."""
        for one in super().render(renderable, options):
            yield one if one.control else one._replace(text=escaped(one.text))


out = Console()
err = Console(stderr=True)
