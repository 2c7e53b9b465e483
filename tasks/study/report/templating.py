"""Load the report's templates, which use the functions of sections and results as filters."""

from __future__ import annotations

from dataclasses import asdict
from inspect import isfunction

from jinja2 import Environment, PackageLoader, StrictUndefined

from tasks.metric import MIN_SAMPLES_FOR_INTERVAL
from tasks.registry import TASKS
from tasks.study.claims import verdict
from tasks.study.report.sections import failures, matrix, scaling, timings, tradeoff
from tasks.study.results import asked, comparison, perturbation, scores, words
from tasks.study.results.choice import capacities_hz
from tasks.study.results.intervals import BRACKETS
from tasks.study.results.previews import FILM_PICTURES, FILM_S

TEMPLATES = Environment(
    loader=PackageLoader("tasks.study.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.globals |= {
    "BRACKETS": BRACKETS,
    "CAPACITIES_MEV_S": [f"{capacity / 1e6:g}" for capacity in capacities_hz()],
    "FILM_TEXT": (
        f"Each picture has the events of {1e3 * FILM_S / FILM_PICTURES:g} ms over the frame at "
        f"their end; a film shows {1e3 * FILM_S:g} ms in a second."
    ),
    "TASKS": TASKS,
    "MIN_SAMPLES": MIN_SAMPLES_FOR_INTERVAL,
    "REQUIRED_SUCCESS": perturbation.REQUIRED_SUCCESS,
    "TRACKING": perturbation.TRACKING,
}
for _module in (
    *(failures, matrix, scaling, timings, tradeoff),
    *(asked, comparison, perturbation, scores, verdict, words),
):
    TEMPLATES.filters |= {
        name: value
        for name, value in vars(_module).items()
        if isfunction(value) and value.__module__ == _module.__name__
    }
TEMPLATES.filters["asdict"] = asdict
TEMPLATES.policies["json.dumps_kwargs"] = {"ensure_ascii": False}
