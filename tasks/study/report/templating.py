"""Load the report's templates and register the functions that they call."""

from __future__ import annotations

import json
from dataclasses import asdict

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.utils import htmlsafe_json_dumps

from tasks.registry import TASKS
from tasks.study.claims.verdict import threshold_note
from tasks.study.report.sections.choice import choice_facts
from tasks.study.results import words
from tasks.study.results.bandwidth import capacities_hz
from tasks.study.results.comparison import line_label
from tasks.study.results.headline import headline
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.perturbation import REQUIRED_SUCCESS

TEMPLATES = Environment(
    loader=PackageLoader("tasks.study.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.globals |= {
    "CAPACITIES_MEV_S": [f"{capacity / 1e6:g}" for capacity in capacities_hz()],
    "TASKS": TASKS,
    "MIN_SAMPLES": MIN_SAMPLES_FOR_INTERVAL,
    "MISSING": words.MISSING,
    "REQUIRED_SUCCESS": REQUIRED_SUCCESS,
}
for _used in (choice_facts, headline, line_label, threshold_note):
    TEMPLATES.filters[_used.__name__] = _used
TEMPLATES.filters |= {name: one for name, one in vars(words).items() if callable(one)}
TEMPLATES.filters["json_text"] = lambda one: json.dumps(one, indent=2, ensure_ascii=False)
TEMPLATES.filters["as_json"] = lambda one: htmlsafe_json_dumps(asdict(one), ensure_ascii=False)
