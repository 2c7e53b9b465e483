"""Tables on stdout that never cut a word, on screens of any width."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import cast

import rich.table
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.segment import Segment

_UNBOUNDED = 100_000  # columns


class Table(rich.table.Table):
    """A table that wraps between words and never shortens them.

    Lines are longer than the screen if it is too narrow for the longest words and for columns that
    may not wrap; print the table with `crop=False`. In a pipe each row is one line.
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        unbounded = options.update(width=_UNBOUNDED)
        least, natural = [], []
        for column in self.columns:
            sizes = [Measurement.get(console, unbounded, c) for c in (column.header, *column.cells)]
            natural.append(max(size.maximum for size in sizes))
            column.width = natural[-1]
            least.append(natural[-1] if column.no_wrap else max(size.minimum for size in sizes))
        padding = Measurement.get(console, unbounded, self).maximum - sum(natural)
        room = options.max_width - padding if console.is_terminal else _UNBOUNDED
        widths = list(_fitted(natural, least, room))
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        wide = options.update(width=max(options.max_width, sum(widths) + padding))
        segments = cast(Iterable[Segment], super().__rich_console__(console, wide))
        for line in Segment.split_lines(segments):
            yield from _without_trailing_blanks(line)
            yield Segment.line()


def _without_trailing_blanks(line: list[Segment]) -> Iterator[Segment]:
    """Drop the padding at the end of a line; in a pipe it may be hundreds of columns."""
    end = len(line)
    while end and not line[end - 1].text.strip():
        end -= 1
    yield from line[: end - 1] if end else []
    if end:
        yield Segment(line[end - 1].text.rstrip(), line[end - 1].style)


def _fitted(natural: list[int], least: list[int], room: int) -> Iterator[int]:
    """Yield column widths: the widest are cut to one width that fits, but not below `least`."""

    def cut_to(width: int) -> list[int]:
        return [max(low, min(full, width)) for full, low in zip(natural, least, strict=True)]

    width = max(natural, default=0)
    while width > 0 and sum(cut_to(width)) > room:
        width -= 1
    yield from cut_to(width)
