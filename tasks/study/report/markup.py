"""Pieces of HTML and English that several parts of the report use."""

from __future__ import annotations

from html import escape


def scrolling(label: str, content: str) -> str:
    """Wrap HTML that may be wider than the page; `label` names it to a screen reader."""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(label)}">'
        f"{content}</div>"
    )
