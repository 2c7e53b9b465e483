"""Which resolution to choose: tables of choices, speeds down, cutoffs across."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.answer import times_text
from tasks.study.results.bandwidth import capacities_hz
from tasks.study.results.choice import Choice, Choices
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.metrics import METRICS, Metric, Series
from tasks.study.results.words import rate_label, share_text


@dataclass(frozen=True, slots=True)
class SceneChoices:
    """One scene: by speed, a choice for each cutoff."""

    scene: str
    lines: dict[float, list[Choice | None]]


@dataclass(frozen=True, slots=True)
class SeriesChoices:
    """One series: a table for each scene."""

    title: str
    metric: Metric
    cutoffs_hz: list[float]
    tables: list[SceneChoices]


@dataclass(frozen=True, slots=True)
class ChoiceTables:
    """All series, and which capacities the buses of real cameras have."""

    series: list[SeriesChoices]
    capacities_mev_s: list[str]
    samples_needed: int = MIN_SAMPLES_FOR_INTERVAL


def choice_tables(run: FinishedRun) -> ChoiceTables:
    """Collect the section."""
    return ChoiceTables(
        [_of_series(one, choices) for one, choices in run.choices.items()],
        [f"{capacity / 1e6:g}" for capacity in capacities_hz()],
    )


def _of_series(series: Series, choices: Choices) -> SeriesChoices:
    cutoffs_hz = list(dict.fromkeys(cutoff for _, cutoff, _ in choices))
    tables = []
    for scene in dict.fromkeys(scene for scene, _, _ in choices):
        speeds = dict.fromkeys(speed for where, _, speed in choices if where == scene)
        lines = {s: [choices.get((scene, c, s)) for c in cutoffs_hz] for s in speeds}
        tables.append(SceneChoices(scene, lines))
    return SeriesChoices(series.title, METRICS[series.metric], cutoffs_hz, tables)


def choice_facts(choice: Choice) -> list[str]:
    """Say what else is to know of a choice, a line each."""
    metric = choice.metric
    score = metric.text(choice.scores[choice.enough])
    facts = [f"{score} {metric.unit} at {rate_label(choice.event_rates_hz[choice.enough])} Mev/s"]
    if choice.enough == choice.best:
        facts.append("the best")
    else:
        saving = choice.saving(choice.best)
        fewer = "" if saving is None else f", {times_text(saving)} times the events"
        loss = f"{metric.text(choice.loss)} {metric.unit}"
        facts.append(f"best {choice.best} px: {loss} better{fewer}")
    if choice.tied is not None and choice.tied != choice.enough:
        facts.append(f"tied: {choice.tied} px")
    if choice.paper is not None:
        facts.append(f"paper: {choice.paper} px")
    facts += _bus_texts(choice)
    if choice.nothing is not None and not choice.worthwhile:
        facts.append(f"doing nothing: {metric.text(choice.nothing)} {metric.unit}")
    return facts


def _bus_texts(choice: Choice) -> list[str]:
    """What is enough on which bus, as in "1 Mev/s bus: none", "12 Mev/s bus: 240 px at 22 %"."""
    if all(bus.enough is None for bus in choice.on_buses):
        return ["on any bus: none"]
    texts = []
    for bus in choice.on_buses:
        answer = "none"
        if bus.enough is not None:
            share = choice.event_rates_hz[bus.enough] / bus.capacity_hz
            answer = f"{bus.enough} px at {share_text(share)}"
        texts.append(f"{bus.capacity_hz / 1e6:g} Mev/s bus: {answer}")
    return texts
