"""The command line's text, tables and progress: `out` prints results to stdout, `err` the rest.

Both print brackets and colons as they are: names of files may have them. Colors are `Text`. Control
characters, of which names and files may be made, are printed as escapes.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from datetime import timedelta
from typing import Any, cast

import rich.console
import rich.table
from rich.console import ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.segment import Segment
from rich.text import Text

from eres_render.progress import Progress

_UNBOUNDED = 100_000  # columns
_LINE_EVERY_S = 60.0
_MIN_DONE = 0.01  # of the work, to tell the time left; before, loading and compiling set the pace
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


class Table(rich.table.Table):
    """A table that wraps between words and never shortens them.

    Lines are longer than the screen if it is too narrow for the longest words and for columns that
    may not wrap; print the table with `crop=False`. In a pipe each row is one line.
    """

    def __init__(self, *headers: str | rich.table.Column, **style: Any) -> None:
        super().__init__(*headers, box=None, **style)

    def __rich_console__(self, console: Any, options: ConsoleOptions) -> RenderResult:
        unbounded = options.update(width=_UNBOUNDED)
        least, natural = [], []
        for column in self.columns:
            sizes = [Measurement.get(console, unbounded, c) for c in (column.header, *column.cells)]
            natural.append(max(size.maximum for size in sizes))
            column.width = natural[-1]
            least.append(natural[-1] if column.no_wrap else max(size.minimum for size in sizes))
        padding = Measurement.get(console, unbounded, self).maximum - sum(natural)
        room = options.max_width - padding if console.is_terminal else _UNBOUNDED
        widths = _fitted(natural, least, room)
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        wide = options.update(width=max(options.max_width, sum(widths) + padding))
        segments = cast(Iterable[Segment], super().__rich_console__(console, wide))
        for line in Segment.split_lines(segments):
            yield from _without_trailing_blanks(line)
            yield Segment.line()


def _without_trailing_blanks(line: list[Segment]) -> list[Segment]:
    """Drop the padding at the end of a line; in a pipe it may be hundreds of columns."""
    while line and not line[-1].text.strip():
        line.pop()
    if line:
        line[-1] = line[-1]._replace(text=line[-1].text.rstrip())
    return line


def _fitted(natural: list[int], least: list[int], room: int) -> list[int]:
    """Return column widths: the widest are cut to one width that fits, but not below `least`."""
    for width in range(max(natural, default=0), -1, -1):
        widths = [max(low, min(full, width)) for full, low in zip(natural, least, strict=True)]
        if sum(widths) <= room:
            break
    return widths


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
    table = Table(show_header=False)
    for name, value in pairs.items():
        if value:
            table.add_row(name, value)
    show(table)


def show_json(value: object) -> None:
    """Print a value as JSON to stdout."""
    from eres_render.storage.json_values import json_values

    print(json.dumps(json_values(value), indent=1))


@contextmanager
def progress() -> Iterator[Progress]:
    """Show stage and time left on stderr: as a bar, or without a terminal as lines."""
    if not err.is_terminal:
        yield _Lines()
        return
    import rich.progress as bars  # here, as it slows down `--help`

    left = bars.TimeElapsedColumn(), "left", bars.TimeRemainingColumn()
    with bars.Progress(
        "{task.description}", bars.BarColumn(), *left, console=err, transient=True
    ) as bar:
        task = bar.add_task("", total=None)

        def update(stage: str, done: float, total: float, /) -> None:
            now = bar.tasks[0]
            if total != now.total or done < now.completed:
                bar.reset(task, total=total)  # another stage has another pace
            bar.update(task, description=stage, completed=done)

        yield update


class _Lines:
    """Prints a line a minute, and none about work that takes less."""

    def __init__(self) -> None:
        self._start_s = self._printed_s = time.monotonic()
        self._start = self._done = 0.0
        self._total: float | None = None

    def __call__(self, stage: str, done: float, total: float, /) -> None:
        now_s = time.monotonic()
        if total != self._total or done < self._done:  # another stage has another pace
            self._total, self._start, self._start_s = total, done, now_s
        self._done = done
        if now_s - self._printed_s < _LINE_EVERY_S:
            return
        self._printed_s = now_s
        elapsed_s = now_s - self._start_s
        line = f"{stage}: {timedelta(seconds=round(elapsed_s))} elapsed"
        reached, whole = done - self._start, total - self._start
        if reached > _MIN_DONE * whole:
            line += f", {timedelta(seconds=round(elapsed_s * (whole / reached - 1)))} left"
        err.print(line, soft_wrap=True)
