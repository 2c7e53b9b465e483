"""The report's templates, and how numbers are written in them."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from tasks.study.report.sections.choice import choice_facts
from tasks.study.report.sections.timings import time_text
from tasks.study.results import words
from tasks.study.results.comparison import line_label

TEMPLATES = Environment(
    loader=PackageLoader("tasks.study.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.globals["MISSING"] = words.MISSING
for _written in (
    choice_facts,
    line_label,
    time_text,
    words.capitalized,
    words.cutoff_detail,
    words.cutoff_label,
    words.join_words,
    words.rate_label,
    words.share_text,
    words.speed_label,
):
    TEMPLATES.filters[_written.__name__] = _written
