"""Describe a table as data; the template macro `table` draws it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tasks.study.results.asked import Condition, Series
from tasks.study.results.scores import Scores, beats
from tasks.study.results.words import MISSING, cutoff_detail, cutoff_label


class Text(NamedTuple):
    """A text followed by a small text. `kind` is "" or "struck"."""

    text: str
    small: str = ""
    kind: str = ""


Rows = Mapping[Text, Sequence[Text]]


class Table(NamedTuple):
    """A table. `blocks` maps the heading of each block to its rows; "" is no heading."""

    caption: str
    heads: Sequence[Text]
    blocks: Mapping[Text, Rows]
    kind: str = ""


def cutoff_text(cutoff_hz: float) -> Text:
    """Return the name and the frequency of a cutoff."""
    return Text(cutoff_label(cutoff_hz), cutoff_detail(cutoff_hz))


def score_text(scores: Scores, series: Series, where: Condition) -> Text:
    """Print a median score."""
    cell = scores.cell(series, where)
    if cell.median is None:
        return Text(MISSING)
    idle = beats(cell, scores.baseline(series, where), series) is False
    return Text(series.spec.metric.text(cell.median), "", "struck" if idle else "")
