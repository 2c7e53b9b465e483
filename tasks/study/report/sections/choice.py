"""Choose a resolution: a table per scene, with speeds as rows and cutoffs as columns."""

from __future__ import annotations

from tasks.study.report.table import Table, Text, cutoff_text
from tasks.study.results.choice import Choice, Choices
from tasks.study.results.words import PACKAGED, BaseSpeeds, rate_label, speed_label


def choice_tables(choices: Choices, base: BaseSpeeds = PACKAGED) -> list[Table]:
    """Make the table of each scene from the choices of one series.

    Parameters
    ----------
    choices
        The choices by scene, cutoff and speed.
    base
        Speed of the camera at factor 1.

    Returns
    -------
    list of Table
        One for each scene.
    """
    cutoffs_hz = list(dict.fromkeys(cutoff for _, cutoff, _ in choices))
    heads = [Text(""), *map(cutoff_text, cutoffs_hz)]
    tables = []
    for scene in dict.fromkeys(scene for scene, _, _ in choices):
        speeds = dict.fromkeys(speed for where, _, speed in choices if where == scene)
        rows = {
            Text(speed_label(scene, speed, base)): [choices[scene, hz, speed] for hz in cutoffs_hz]
            for speed in speeds
        }
        tables.append(Table("choice", f"Choice, {scene}", scene, heads, {Text(""): rows}))
    return tables


def choice_facts(choice: Choice) -> list[str]:
    """Return facts about a choice, one line each."""
    metric = choice.metric

    def scored(value: float) -> str:
        return f"{metric.text(value)} {metric.unit}"

    rate = rate_label(choice.event_rates_hz[choice.enough])
    facts = [f"{scored(choice.scores[choice.enough])} at {rate} Mev/s"]
    if choice.enough == choice.best:
        facts.append("the best")
    else:
        saving = choice.saving(choice.best)
        fewer = "" if saving is None else f", {_times_text(saving)} times the events"
        facts.append(f"best {choice.best} px: {scored(choice.loss)} better{fewer}")
    if choice.tied is not None and choice.tied != choice.enough:
        facts.append(f"tied: {choice.tied} px")
    if choice.paper is not None:
        facts.append(f"paper: {choice.paper} px")
    if choice.nothing is not None and not choice.worthwhile:
        facts.append(f"doing nothing: {scored(choice.nothing)}")
    return facts


def _times_text(ratio: float) -> str:
    """Format a ratio to two digits, or to whole numbers from 10 on."""
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:.0f}"
