"""Comparison tables for a terminal."""

from __future__ import annotations

import rich.console
from rich.text import Text

from tasks.cli import terminal
from tasks.study.results.comparison import Block, Column, ComparisonTable, line_label
from tasks.study.results.words import PACKAGED, BaseSpeeds, cutoff_label, speed_label


def to_rich(table: ComparisonTable, base: BaseSpeeds = PACKAGED) -> rich.console.Group:
    """Render for a terminal of 80 columns or more, each block under its own heading.

    Parameters
    ----------
    table
        The table.
    base
        Mean speed of the camera at factor 1 by scene, m/s.

    Returns
    -------
    The table with title and footnote.
    """
    columns = [column for column in table.columns if column.in_terminal]
    parts: list[rich.console.RenderableType] = [Text(table.title, "bold")]
    for block in table.blocks:
        parts += [Text(f"\n{block.scene}, {speed_label(block.scene, block.speed, base)}", "italic")]
        parts += [_rich_block(block, table, columns)]
    note = table.footnote(columns)
    return rich.console.Group(*parts, Text(f"\n{note}", "dim"))


def _rich_block(block: Block, table: ComparisonTable, columns: list[Column]) -> terminal.Table:
    shown = terminal.Table(padding=(0, 1, 0, 0), pad_edge=False, header_style="dim")
    shown.add_column("", no_wrap=True)
    for cutoff_hz in table.cutoffs_hz:
        for column in columns:
            head = cutoff_label(cutoff_hz) if column.kind == "ours" else column.head
            dim = "dim" if column.kind in ("paper", "rate") else ""
            shown.add_column(head, justify="right", style=dim, no_wrap=True)
    for line in block.lines:
        cells = [Text("do nothing" if line.sensor is None else line_label(line, table.series))]
        for entry in line.entries:
            for column in columns:
                text = column.text(table.series, entry, line)
                cells.append(Text(text, entry.marks.get(column.kind, "")))
        shown.add_row(*cells)
    return shown
