"""Compare what resolution and the paper's claims look like with each photoreceptor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from sensor.model import PHOTORECEPTORS
from tasks.study.claims.judge import changed_verdicts
from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.table import Table, Text
from tasks.study.results.asked import SensorId, Series
from tasks.study.results.choice import Choice, choose
from tasks.study.results.intervals import Interval, lead_over
from tasks.study.results.perturbation import is_main
from tasks.study.results.scores import Scores
from tasks.study.results.words import MISSING, capitalized, photoreceptor_label, setting_label


@dataclass(frozen=True, slots=True)
class Lead:
    """How much better the finest sensor is than the finest of a smaller width, by photoreceptor.

    The paper's lead is None if the paper lacks one of the two.
    """

    scene: str
    cutoff_hz: float
    speed: float
    sensors: tuple[SensorId, SensorId]
    intervals: Mapping[str, Interval | None]
    paper: float | None


def leads(readings: Mapping[str, Scores], series: Series) -> list[Lead]:
    """Return the leads of a series in every light but the ideal, where photoreceptors are equal;
    with v2e's program, whose times are its own, in that too."""
    first = next(iter(readings.values()))
    sensors = first.sensors(series)
    coarser = [sensor for sensor in sensors if sensor.width < sensors[-1].width]
    if not coarser:
        return []
    pair = sensors[-1], coarser[-1]
    sign = series.spec.metric.sign
    conditions = dict.fromkeys(at[:1] + at[2:4] for at in first.conditions(series))
    every = []
    for scene, cutoff_hz, speed in conditions:
        if math.isinf(cutoff_hz) and readings.keys() <= {*PHOTORECEPTORS}:
            continue
        places = [s.at(scene, cutoff_hz, speed) for s in pair]
        intervals: dict[str, Interval | None] = {}
        for name, scores in readings.items():
            ours = [scores.cell(series, at) for at in places]
            complete = all(cell.complete for cell in ours)
            intervals[name] = lead_over(ours[0], ours[1], sign) if complete else None
        fine, coarse = (first.published(series, at) for at in places)
        paper = None if fine is None or coarse is None else sign * (fine - coarse)
        every.append(Lead(scene, cutoff_hz, speed, pair, intervals, paper))
    return every


def compare_photoreceptors(run: FinishedRun) -> dict[str, object] | None:
    """Compare the photoreceptors of a run; None if it has only one.

    `names` begin with the photoreceptor of the page, and `programs` says whether some are v2e's
    program. `tables` has a table of leads for each main method; `verdicts` has the verdicts that
    change.
    """
    if not run.others:
        return None
    readings = run.readings
    names = [photoreceptor_label(name) for name in readings]
    heads = [Text(name, "" if i else "this page") for i, name in enumerate(names)]
    tables = [
        _table(series, of_series, heads, run)
        for series in run.series
        if is_main(series) and (of_series := leads(readings, series))
    ]
    rows = {
        Text(f"{of_claim[0].number}", of_claim[0].title): [Text(v.status) for v in of_claim]
        for of_claim in changed_verdicts(run.verdicts_by_photoreceptor)
    }
    verdicts = Table("Claims with another verdict", [Text("claim"), *heads], {Text(""): rows})
    programs = not readings.keys() <= {*PHOTORECEPTORS}
    return {"names": names, "tables": tables, "verdicts": verdicts, "programs": programs}


def _table(series: Series, of_series: list[Lead], heads: list[Text], run: FinishedRun) -> Table:
    metric = series.spec.metric
    with_paper = any(lead.paper is not None for lead in of_series)
    blocks: dict[Text, dict[Text, list[Text]]] = {}
    for lead in of_series:
        at = lead.scene, lead.cutoff_hz, lead.speed
        choices = [choose(scores, series, *at) for scores in run.readings.values()]
        cells = [
            Text(MISSING)
            if interval is None or choice is None
            else Text(interval.text(metric.decimals), _enough(choice))
            for interval, choice in zip(lead.intervals.values(), choices, strict=True)
        ]
        paper = MISSING if lead.paper is None else metric.text(lead.paper, "+")
        head = Text(setting_label(*at, run.base_speeds))
        rows = blocks.setdefault(Text(lead.scene), {})
        if head in rows:  # speeds that differ by less than their digits
            head = head._replace(small=f"{lead.speed:g} times the base speed")
        rows[head] = [*cells, *[Text(paper)] * with_paper]
    fine, coarse = (sensor.label for sensor in of_series[0].sensors)
    caption = f"{capitalized(series.title)}: lead of {fine} over {coarse}, {metric.unit}"
    last = [Text("paper")] * with_paper
    return Table(caption, [Text(""), *heads, *last], blocks)


def _enough(choice: Choice) -> str:
    if not choice.worthwhile:
        return "doing nothing is as good"
    return f"enough: {choice.enough.label}"
