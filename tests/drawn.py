"""Pieces of the report, drawn alone."""

from tasks.study.report.sections.summary import answer
from tasks.study.report.templating import TEMPLATES
from tasks.study.results.choice import Choices
from tasks.study.results.metrics import Series


def macro(name: str, *values: object, **named: object) -> str:
    """Draw a macro of the templates."""
    return str(getattr(TEMPLATES.get_template("macros.html").module, name)(*values, **named))


def answer_html(choices: Choices, series: Series, *, named: bool = False) -> str:
    """Draw the answer to one task."""
    return macro("answer", answer(choices, series), named=named).strip()
