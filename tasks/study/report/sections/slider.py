"""The virtual slider: the paper's table of real data beside our scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tasks.registry import TASKS
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.table import Rows, Table, Text, score_text
from tasks.study.results.asked import Condition, Series
from tasks.study.results.scores import Scores
from tasks.study.results.slider import (
    FACTORS,
    FIELD_PX,
    NOTHING_MM,
    PRINTS,
    SIZES_PX,
    SPEEDS_M_PER_S,
    distance_label,
    is_of_slider,
    light_label,
    slider_scores,
    worse_than_nothing,
)
from tasks.study.results.words import MISSING

_WIDTHS = [width for width, _ in FIELD_PX]

_Paper = Mapping[tuple[str, float], Sequence[float]]  # by print and speed: values by distance


def slider_section(run: FinishedRun) -> dict[str, object] | None:
    """Compare a run on the virtual slider with the paper; None if the run has no such scores.

    `wins` counts the prints on which the full size is best. `worse_than_nothing` counts the paper's
    9 position errors at the highest speed that exceed the error of the initial path, `nothing_mm`.
    """
    scores, papers = run.scores, slider_scores()
    ours = [s for s in scores.series() if s[:2] in papers and _measured(scores, s)]
    if not (ours and is_of_slider(run.config)):
        return None
    pairs = [
        (series, paper)
        for (task, method), paper in papers.items()
        for series in [series for series in ours if series[:2] == (task, method)]
        or [Series(task, method, TASKS[task].metric.name)]
    ]
    return {
        "wins": _wins(scores, pairs),
        "tables": {series.title: _table(scores, series, paper) for series, paper in pairs},
        "worse_than_nothing": worse_than_nothing(SPEEDS_M_PER_S[-1]),
        "nothing_mm": NOTHING_MM,
    }


def _measured(scores: Scores, series: Series) -> bool:
    places = {(name, width, v) for name in PRINTS for width in _WIDTHS for v in FACTORS.values()}
    measured = {(at.scene, at.width, at.speed) for at in scores.conditions(series) if not at.sensor}
    return not places.isdisjoint(measured)


def _table(scores: Scores, series: Series, paper: _Paper) -> Table:
    """List all scores of a series, with the paper's and those of doing nothing."""
    metric = series.spec.metric
    blocks: dict[Text, Rows] = {}
    for scene in PRINTS:
        for speed, factor in FACTORS.items():
            where = [Condition(scene, width, 0.0, factor) for width in _WIDTHS]
            fields = zip(paper[scene, speed], SIZES_PX[scene], strict=True)
            rows = {Text("paper"): [_paper_text(series, v, width) for v, (width, _) in fields]}
            lights = scores.cutoffs_hz(series)
            for hz in lights:
                rows[Text(light_label(hz))] = [
                    score_text(scores, series, at._replace(cutoff_hz=hz)) for at in where
                ]
            if lights:  # doing nothing is the same in every light
                idle = [scores.baseline(series, at._replace(cutoff_hz=lights[0])) for at in where]
                rows[Text("doing nothing")] = [
                    Text(MISSING if c.median is None else metric.text(c.median)) for c in idle
                ]
            blocks[Text(scene, f"{speed:g} m/s")] = rows
    heads = [Text(""), *(Text(f"{width} px", distance_label(width)) for width in _WIDTHS)]
    caption = f"{series.title}: median {metric.heading}"
    return Table(caption, heads, blocks)


def _paper_text(series: Series, value: float, width: int) -> Text:
    """Return a score of the paper with the width of its own field."""
    worse = series.task == "tracking" and value > NOTHING_MM
    small = "" if width in _WIDTHS else f"{width} px"
    return Text(series.spec.metric.text(value), small, "struck" if worse else "")


def _wins(scores: Scores, pairs: Sequence[tuple[Series, _Paper]]) -> Table:
    """Count the prints on which the full size is best, by series, light and speed."""
    blocks: dict[Text, Rows] = {}
    for series, paper in pairs:
        rows = {Text("paper"): [_share(series, [paper[s, v] for s in PRINTS]) for v in FACTORS]}
        for hz in scores.cutoffs_hz(series):
            rows[Text(light_label(hz))] = []
            for speed in FACTORS.values():
                places = [[Condition(s, w, hz, speed) for w in _WIDTHS] for s in PRINTS]
                medians = [
                    [scores.cell(series, at).median for at in of_print] for of_print in places
                ]
                rows[Text(light_label(hz))].append(_share(series, medians))
        blocks[Text(series.title)] = rows
    heads = [Text(""), *(Text(f"{speed:g} m/s") for speed in SPEEDS_M_PER_S)]
    return Table("On how many prints the full size is best", heads, blocks)


def _share(series: Series, prints: Sequence[Sequence[float | None]]) -> Text:
    """Count the prints on which the full size is best, of those with scores of all widths."""
    sign = series.spec.metric.sign
    known = [[sign * value for value in values if value is not None] for values in prints]
    complete = [values for values in known if len(values) == len(_WIDTHS)]
    best = sum(values[-1] == max(values) for values in complete)
    return Text(f"{best} of {len(complete)}" if complete else MISSING)
