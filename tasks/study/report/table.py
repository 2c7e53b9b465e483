"""A table as data; the macro `table` of the templates draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tasks.study.results.choice import Choice
from tasks.study.results.words import cutoff_detail, cutoff_label


class Text(NamedTuple):
    """A text, with what stands small after it; `kind` is "struck" or "over" (a limit)."""

    text: str
    small: str = ""
    kind: str = ""


Cell = Sequence[Text] | Choice | None  # several texts are a change from one to the other
Rows = Mapping[Text, Sequence[Cell]]


@dataclass(frozen=True, slots=True)
class Table:
    """A table, with its rows by the heading of their block; one that is empty is not shown.

    Attributes
    ----------
    kind
        What the page styles it by.
    label
        Names it to a screen reader.
    """

    kind: str
    label: str
    caption: str
    heads: Sequence[Text]
    blocks: Mapping[Text, Rows]


def cutoff_text(cutoff_hz: float) -> Text:
    """Name a cutoff, with its frequency."""
    return Text(cutoff_label(cutoff_hz), cutoff_detail(cutoff_hz))


def width_texts(widths: Sequence[int]) -> list[Text]:
    """Name sensor widths."""
    return [Text(f"{width} px") for width in widths]
