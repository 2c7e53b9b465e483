"""Write the report of a run: one self-contained HTML file, static figures and a CSV table."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Template

from eres_render.storage.atomic import encoded, write_bytes, write_text
from sensor.model import PHOTORECEPTORS
from tasks.errors import ResultError
from tasks.registry import TASKS
from tasks.study.report.figures import figure_files
from tasks.study.report.finished_run import FinishedRun, read_run
from tasks.study.report.plot import COLORS
from tasks.study.report.sections.photoreceptor import compare_photoreceptors
from tasks.study.report.sections.scaling import interval_plot, slope_plot
from tasks.study.report.sections.slider import slider_section
from tasks.study.report.sections.tradeoff import tradeoff_plots
from tasks.study.report.templating import TEMPLATES
from tasks.study.results.comparison import comparison_table, to_csv
from tasks.study.results.perturbation import is_main

MAX_BYTES = 15_000_000
"""Maximum size of a report, bytes."""

_SCALING = "scaling_slope", "scaling_intervals"


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the page.

    Attributes
    ----------
    id
        Anchor.
    link
        Name in the navigation.
    title
        Heading.
    template
        File in ``templates/``, or a template of your own. It reads ``data`` and ``run``.
    data
        Function that returns ``data`` for a run, by default the run itself. If it returns None, the
        section is left out.
    """

    id: str
    link: str
    title: str
    template: str | Template
    data: Callable[[FinishedRun], object] = lambda run: run


SECTIONS = (
    Section("tradeoff", "Trade-off", "Score against event rate", "tradeoff.html"),
    Section(
        "previews",
        "Previews",
        "Events of each sensor",
        "previews.html",
        lambda run: run.previews or None,
    ),
    Section("tables", "Tables", "All scores", "comparison.html"),
    Section("slider", "Slider", "On the slider, beside the paper", "slider.html", slider_section),
    Section(
        "threshold",
        "Threshold",
        "Contrast threshold",
        "threshold.html",
        lambda run: run.by_threshold[1:] or None,
    ),
    Section(
        "photoreceptor",
        "Photoreceptor",
        "Photoreceptor",
        "photoreceptor.html",
        compare_photoreceptors,
    ),
    Section("failures", "Failures", "Failures", "failures.html"),
    Section(
        "scaling",
        "Scaling",
        "Why finer sensors fire faster",
        "scaling.html",
        lambda run: run.scaling.keys() & run.scenes or None,
    ),
    Section("claims", "Claims", "The paper's claims", "claims.html"),
    Section(
        "costs", "Timings", "Timings of this run", "timings.html", lambda run: run.timings or None
    ),
    Section("provenance", "Provenance", "Provenance", "provenance.html"),
)
"""Sections of a report, in order."""


def write_report(run: str | Path | FinishedRun, sections: Sequence[Section] = SECTIONS) -> Path:
    """Write ``report.html``, ``tables.csv`` and ``figures/tradeoff_METHOD.png`` and ``.svg``.

    A run with ``scaling/`` also has ``figures/scaling_slope`` and ``scaling_intervals``. Each other
    photoreceptor of the run has its own ``tables_NAME.csv``.

    Parameters
    ----------
    run
        A run that was read, or its folder. It holds ``rows.parquet``, ``environment.json`` (strings
        by name) and ``study.json`` (resolved configuration). It can also hold ``previews/``
        (``index.json``, PNG and WebP files), ``scaling/`` (a JSON and a PNG file per scene) and
        ``costs/`` (a JSON file per job).
    sections
        Sections of the page, in order; append your own to `SECTIONS`.

    Returns
    -------
    Path
        ``report.html``. It is written whole or not at all.

    Raises
    ------
    ResultError
        A file is missing or damaged, rows contradict each other, or the report exceeds
        `MAX_BYTES`.
    """
    run = run if isinstance(run, FinishedRun) else read_run(Path(run))
    shown = [(section, data) for section in sections if (data := section.data(run)) is not None]
    template = TEMPLATES.get_template("page.html")
    page = encoded(template.render(colors=COLORS, run=run, sections=shown))
    if len(page) > MAX_BYTES:
        raise ResultError(
            f"{run.folder}: the report has {len(page) / 1e6:.1f} MB, expected at most "
            f"{MAX_BYTES / 1e6:.0f} MB; list fewer previews in previews/index.json"
        )
    others = {f"tables_{name}": scores for name, scores in run.others.items()}
    for name, scores in {"tables": run.by_threshold, **others}.items():
        tables = [comparison_table(each, series) for each in scores for series in each.series()]
        write_text(run.folder / f"{name}.csv", to_csv(tables))
    for name in {f"tables_{kind}" for kind in PHOTORECEPTORS} - others.keys():
        (run.folder / f"{name}.csv").unlink(missing_ok=True)  # that the run no longer has
    figures = run.folder / "figures"
    # Of our methods, the run may no longer have some; a file of another name may be the user's.
    ours = {f"tradeoff_{m}" for task in TASKS.values() for m in task.methods} | {*_SCALING}
    drawn = {
        re.sub(r"\W+", "_", f"tradeoff_{series.method}"): tradeoff_plots(run, series)
        for series in filter(is_main, run.series)
    }
    if measured := {name: run.scaling[name] for name in run.scenes if name in run.scaling}:
        slopes = {name: slope_plot(scaling) for name, scaling in measured.items()}
        intervals = {
            name: interval_plot(scaling, run.base_speeds) for name, scaling in measured.items()
        }
        drawn |= zip(_SCALING, (slopes, intervals), strict=True)
    for name, plots in drawn.items():
        for kind, image in figure_files(plots).items():
            write_bytes(figures / f"{name}.{kind}", image)
    for name in ours - drawn.keys():
        for kind in ("png", "svg"):
            (figures / f"{name}.{kind}").unlink(missing_ok=True)
    report = run.folder / "report.html"
    write_bytes(report, page)
    return report
