"""Sections of the report and pieces of them, drawn alone."""

import re

from tasks.study.report.sections.comparison import Comparison
from tasks.study.report.sections.summary import answer
from tasks.study.report.templating import TEMPLATES
from tasks.study.results.choice import Choice, Choices
from tasks.study.results.comparison import ComparisonTable
from tasks.study.results.metrics import Series


def section(template: str, **data: object) -> str:
    """Draw a template, without the white space between its tags."""
    text = TEMPLATES.get_template(template).render(**data)
    return re.sub(r">\s+<", "><", text)


def answer_html(choices: Choices, series: Series, *, named: bool = False) -> str:
    """Draw the answer to one task."""
    return str(_macros().answer(answer(choices, series), named=named)).strip()


def choice_cell(choice: Choice | None) -> str:
    """Draw a place of a table of choices."""
    return str(_macros().choice_cell(choice))


def comparison_html(table: ComparisonTable) -> str:
    """Draw our medians and the paper's."""
    return section("comparison.html", data=[Comparison(table, table)])


def _macros():
    return TEMPLATES.get_template("macros.html").module
