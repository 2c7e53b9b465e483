"""Pieces of HTML and English that several parts of the report use."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def scrolling(label: str, content: str) -> str:
    """Wrap HTML that may be wider than the page; `label` names it to a screen reader."""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(label)}">'
        f"{content}</div>"
    )


def join_words(words: Sequence[str], last: str = "and") -> str:
    """Join as in "carpet, rocks and room"."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
