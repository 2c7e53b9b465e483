"""The progress bar of the command line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from eres_render.progress import Progress as OnProgress


@contextmanager
def progress_bar(console: Console) -> Iterator[OnProgress]:
    """Draw stage, elapsed time and time left; draw nothing without a terminal."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    shown = Progress(*columns, console=console, disable=not console.is_terminal, transient=True)
    with shown as bar:
        task = bar.add_task("", total=None)

        def update(stage: str, done: float, total: float, /) -> None:
            now = bar.tasks[0]
            if total != now.total or done < now.completed:
                bar.reset(task, total=total)  # another stage has another pace
            bar.update(task, description=stage, completed=done)

        yield update
