"""Draw single sections of the report, and parts of them."""

import re
from types import SimpleNamespace

from tasks.study.report.templating import TEMPLATES
from tasks.study.results.comparison import ComparisonTable
from tasks.study.results.words import PACKAGED


def section(template: str, **data: object) -> str:
    """Draw a template, without the white space between its tags."""
    return without_space(TEMPLATES.get_template(template).render(**data))


def without_space(page: str) -> str:
    """Leave out the white space between tags."""
    return re.sub(r">\s+<", "><", page)


def comparison_html(table: ComparisonTable) -> str:
    """Draw our medians and the paper's."""
    template = TEMPLATES.get_template("comparison.html")
    run = SimpleNamespace(series=[], base_speeds=PACKAGED)
    return without_space(template.make_module({"run": run}).scores(table))
