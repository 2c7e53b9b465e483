"""The report's tables of our medians beside the paper's."""

from __future__ import annotations

import html

from tasks.study.results.comparison import (
    Column,
    ComparisonTable,
    Entry,
    Line,
    columns_of,
    line_label,
)
from tasks.study.results.words import (
    cutoff_detail,
    cutoff_label,
    speed_label,
)


def to_html(table: ComparisonTable) -> str:
    """Render as one ``<table>``, each block a ``<tbody>``."""
    columns = columns_of(table)
    groups = "".join(
        f'<th scope="colgroup" colspan="{len(columns)}">{html.escape(cutoff_label(c))} '
        f"<small>{html.escape(cutoff_detail(c))}</small></th>"
        for c in table.cutoffs_hz
    )
    heads = "".join(f'<th scope="col">{column.head}</th>' for column in columns)
    parts = [
        f'<table class="scores"><caption><span>{html.escape(table.title)}</span></caption>',
        f'<thead><tr><th rowspan="2" scope="col">sensor</th>{groups}</tr>',
        f"<tr>{heads * len(table.cutoffs_hz)}</tr></thead>",
    ]
    for block in table.blocks:
        speed = speed_label(block.scene, block.speed)
        title = f"{html.escape(block.scene)} <small>{speed}</small>"
        span = 1 + len(columns) * len(table.cutoffs_hz)
        parts.append(
            f'<tbody><tr class="block"><th scope="rowgroup" colspan="{span}">'
            f"<span>{title}</span></th></tr>"
        )
        for line in block.lines:
            label = html.escape(line_label(line, table.series))
            kind = ' class="baseline"' if line.nothing else ""
            cells = "".join(
                _html_cell(column, entry, line) for entry in line.entries for column in columns
            )
            parts.append(f'<tr{kind}><th scope="row">{label}</th>{cells}</tr>')
        parts.append("</tbody>")
    parts.append("</table>")
    return "\n".join(parts)


def _html_cell(column: Column, entry: Entry, line: Line) -> str:
    text = column.text(entry, line)
    if column.kind == "ours" and entry.beats_nothing is False:
        text = f"<s>{text}</s>"
    if {"ours": entry.best, "paper": entry.paper_best}.get(column.kind, False):
        text = f"<strong>{text}</strong>"
    return f'<td class="{column.kind}">{text}</td>'
