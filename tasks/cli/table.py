"""Tables on stdout in which every word is whole, however narrow the screen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import cast

import rich.table
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.segment import Segment

_UNBOUNDED = 100_000  # columns


class Table(rich.table.Table):
    """A table that breaks lines between words, and shortens none.

    Where the screen has no room for its longest words side by side, or for what may not wrap, lines
    go beyond the edge: print it with `crop=False`. In a pipe each row is one line.
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
    """The padding at a line's end is of no use, and in a pipe may be hundreds of columns."""
    end = len(line)
    while end and not line[end - 1].text.strip():
        end -= 1
    yield from line[: end - 1] if end else []
    if end:
        yield Segment(line[end - 1].text.rstrip(), line[end - 1].style)


def _fitted(natural: list[int], least: list[int], room: int) -> Iterator[int]:
    """Widths of columns: the widest are cut to one width that fits, none below its least."""

    def cut_to(width: int) -> list[int]:
        return [max(low, min(full, width)) for full, low in zip(natural, least, strict=True)]

    width = max(natural, default=0)
    while width > 0 and sum(cut_to(width)) > room:
        width -= 1
    yield from cut_to(width)
