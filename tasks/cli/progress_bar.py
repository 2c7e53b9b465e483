"""Progress on the command line: a bar in a terminal, lines in a log."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Console
from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

from eres_render.progress import Progress as OnProgress

_LINE_EVERY_S = 60.0
_MIN_DONE = 0.01  # of the work, to tell the time left; before, loading and compiling set the pace


@contextmanager
def progress_bar(console: Console) -> Iterator[OnProgress]:
    """Show stage, elapsed time and time left: as a bar, or without a terminal as lines."""
    if not console.is_terminal:
        yield _Lines(console)
        return
    columns = "{task.description}", BarColumn(), TimeElapsedColumn(), "left", TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=None)

        def update(stage: str, done: float, total: float, /) -> None:
            now = bar.tasks[0]
            if total != now.total or done < now.completed:
                bar.reset(task, total=total)  # another stage has another pace
            bar.update(task, description=stage, completed=done)

        yield update


class _Lines:
    """Prints a line a minute, and none about work that takes less."""

    def __init__(self, console: Console) -> None:
        self._console = console
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
            left_s = elapsed_s * (whole / reached - 1)
            line += f", {timedelta(seconds=round(left_s))} left"
        self._console.print(line, soft_wrap=True)
