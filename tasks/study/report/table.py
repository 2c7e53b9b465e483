"""Describe a table as data; the template macro `table` draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tasks.study.results.words import cutoff_detail, cutoff_label


class Text(NamedTuple):
    """A text followed by a small text. `kind` is "", "struck" or "over" (above a limit)."""

    text: str
    small: str = ""
    kind: str = ""


Rows = Mapping[Text, Sequence[Text]]


@dataclass(frozen=True, slots=True)
class Table:
    """A table. `blocks` maps the heading of each block to its rows; "" is no heading.

    Attributes
    ----------
    kind
        CSS class.
    label
        Name for screen readers.
    """

    kind: str
    label: str
    caption: str
    heads: Sequence[Text]
    blocks: Mapping[Text, Rows]


def cutoff_text(cutoff_hz: float) -> Text:
    """Return the name and the frequency of a cutoff."""
    return Text(cutoff_label(cutoff_hz), cutoff_detail(cutoff_hz))


def width_texts(widths: Sequence[int]) -> list[Text]:
    """Return the names of sensor widths."""
    return [Text(f"{width} px") for width in widths]
