"""The answer of a study: which sensor is enough for each task, light and speed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from tasks.study.report.finished_run import FinishedRun
from tasks.study.report.table import Text, cutoff_text
from tasks.study.results.asked import SensorId, Series
from tasks.study.results.choice import capacities_hz, choose, designs_of, width_in_design
from tasks.study.results.perturbation import is_main
from tasks.study.results.scores import Scores
from tasks.study.results.words import (
    MISSING,
    capitalized,
    join_words,
    rate_label,
    setting_label,
)


class Shown(NamedTuple):
    """The sensor that is enough, by its name or width; its event rate and share of the bus; its
    rank, 0 to 100 %."""

    width: str
    facts: str
    fineness: str = "0%"


class Answer(NamedTuple):
    """The answer for a task in one light at one speed.

    `shown` is what the page shows without a limit, then for each bus of real cameras. `kind` is "",
    "struck" (doing nothing is as good) or "over" (more events than the bus carries). `tied` is a
    smaller sensor that the samples do not separate from the best.
    """

    where: str
    shown: Sequence[Shown]
    kind: str = ""
    tied: str | None = None


def matrix(run: FinishedRun) -> dict[str, object]:
    """Return the answers of a run: the main methods at the speeds that all have, or else most.

    `compared` and `uncompared` are the tasks in which doing nothing was scored, and was not. `near`
    has the negligible differences in the units of the metrics. Each of the `lights` is a group of
    columns, with a column for each of the `speeds`; `rows` has the answers for each scene and task.
    """
    scores = run.scores
    main = [series for series in run.series if is_main(series)] or run.firsts
    cutoffs_hz = sorted({hz for series in main for hz in scores.cutoffs_hz(series)}, reverse=True)
    widths = sorted({sensor.width for series in main for sensor in scores.sensors(series)})
    pairs = [(series, scene) for series in main for scene in scores.scenes(series)]
    counts = Counter(speed for pair in pairs for speed in scores.speeds(*pair))
    speeds = sorted(speed for speed in counts if counts[speed] == max(counts.values()))
    rows: dict[str, dict[Text, list[Answer]]] = {
        scene: {
            row: [
                _answer(run, series, (scene, hz, speed), widths, others)
                for hz in cutoffs_hz
                for speed in speeds
            ]
            for series in main
            if {*speeds} & {*scores.speeds(series, scene)}
            for row, others in _rows(scores, series)
        }
        for scene in run.scenes
    }
    metrics = dict.fromkeys(series.spec.metric for series in main)
    tasks = dict.fromkeys(series.spec.title for series in main)
    compared = {
        series.spec.title
        for series in main
        if any(scores.baseline(series, at).median is not None for at in scores.conditions(series))
    }
    return {
        "near": join_words([metric.near for metric in metrics], "or"),
        "compared": [task for task in tasks if task in compared],
        "uncompared": [task for task in tasks if task not in compared],
        "widths": widths,
        "lights": [*map(cutoff_text, cutoffs_hz)],
        "speeds": speeds,
        "rows": rows,
    }


def _rows(scores: Scores, series: Series) -> list[tuple[Text, list[SensorId]]]:
    """Return the head of each row of a series, one for each design, and the sensors left out."""
    label, designs = series.spec.label(series.method), designs_of(scores.sensors(series))
    if not designs:
        return [(Text(capitalized(series.spec.title), label), [])]
    return [(Text(capitalized(label), name), others) for name, others in designs.items()]


def _answer(
    run: FinishedRun,
    series: Series,
    at: tuple[str, float, float],
    widths: Sequence[int],
    others: Sequence[SensorId],
) -> Answer:
    scene, cutoff_hz, speed = at
    where = setting_label(scene, cutoff_hz, speed, run.base_speeds)
    choice = choose(run.scores, series, *at, others)
    if choice is None:
        asked = any((c.scene, c.cutoff_hz, c.speed) == at for c in run.scores.conditions(series))
        missing = Shown(MISSING, "samples are missing" if asked else "not in this study")
        return Answer(where, [missing] * (1 + len(capacities_hz())))
    rates_hz = choice.event_rates_hz

    def shown(sensor: SensorId, bus_hz: float) -> Shown:
        share = rates_hz[sensor] / bus_hz
        of_bus = "<1" if share < 0.01 else round(100 * share)
        fineness = round(100 * widths.index(sensor.width) / max(len(widths) - 1, 1))
        facts = f"{rate_label(rates_hz[sensor])} · {of_bus}\u202f%"
        return Shown(width_in_design(sensor), facts, f"{fineness}%")

    own_hz = run.buses_hz[choice.enough]
    usual = shown(choice.enough, own_hz)
    if not choice.worthwhile:
        on_any_bus = usual._replace(facts="on any bus")
        return Answer(where, [usual, *[on_any_bus] * len(choice.on_buses)], "struck")
    on_buses = [
        Shown("none", "is enough on this bus") if sensor is None else shown(sensor, bus_hz)
        for bus_hz, sensor in choice.on_buses.items()
    ]
    over = rates_hz[choice.enough] > own_hz
    tied = None if choice.tied is None else width_in_design(choice.tied)
    return Answer(where, [usual, *on_buses], "over" if over else "", tied)
