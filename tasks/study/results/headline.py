"""State in words which resolution is enough, in which light and at which speed.

The report's headline, README and docs/results.md use this text. `choose` selects the widths and
`answered` the conditions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from tasks.registry import TASKS
from tasks.study.results.choice import Choice, Choices, answered
from tasks.study.results.metrics import Series
from tasks.study.results.words import cutoff_label, join_words


def headline(choices: Choices, series: Series) -> str:
    """State which width is enough under up to three conditions.

    These are the most and the least light at the lowest speed, and the least light at the highest
    speed. Scenes are named if the run has several.

    Parameters
    ----------
    choices
        Choices of one series.
    series
        Method and task.

    Returns
    -------
    str
        Sentences in Markdown; widths are bold.
    """
    scenes = list(dict.fromkeys(scene for scene, _, _ in choices))
    conditions = answered(choices)
    sentences = []
    for cutoff, speed in dict.fromkeys([conditions[0], *conditions[-2:]]):
        found = {scene: choices[scene, cutoff, speed] for scene in scenes}
        light = {"ideal": "In ideal light", "day": "By day", "night": "At night"}.get(
            cutoff_label(cutoff), f"At a cutoff of {cutoff:g} Hz"
        )
        sentences.append(f"{light} and speed {speed:.2g}, {_enough_text(found, series)}.")
    answer = " ".join(sentences)
    return f"On {scenes[0]}, {answer[0].lower()}{answer[1:]}" if len(scenes) == 1 else answer


def _enough_text(found: Mapping[str, Choice | None], series: Series) -> str:
    """State which width is enough on which scene; a single scene is not named."""

    def on(scenes: Iterable[str]) -> str:
        return f" on {join_words(list(scenes))}" if len(found) > 1 else ""

    def where(choices: Iterable[Choice]) -> str:
        return on(choice.scene for choice in choices)

    measured = [choice for choice in found.values() if choice]
    useful = [choice for choice in measured if choice.worthwhile]
    coarser = [choice for choice in useful if choice.enough < max(choice.scores)]
    parts = []
    if coarser:
        groups = [
            f"**{width} px** is enough{where(c for c in coarser if c.enough == width)}"
            for width in sorted({choice.enough for choice in coarser})
        ]
        parts.append(f"{join_words(groups)}{_near_text(coarser, series)}{_fewer_text(coarser)}")
    if finest := [choice for choice in useful if choice not in coarser]:
        gain = _gain_text(finest, series)
        gain = gain and f" ({gain})"
        parts.append(f"it takes all **{finest[0].enough} px**{where(finest)}{gain}")
    if idle := [choice for choice in measured if not choice.worthwhile]:
        parts.append(f"no resolution beats doing nothing{where(idle)}")
    if unknown := [scene for scene, choice in found.items() if choice is None]:
        parts.append(f"not all samples are measured{on(unknown)}")
    return "; ".join(parts)


def _near_text(choices: list[Choice], series: Series) -> str:
    """State how close these are to the best, and how good the best is."""
    metric = TASKS[series.task].metric
    gain = _gain_text(choices, series)
    if all(choice.enough == choice.best for choice in choices):
        return f" (the best{gain and f', {gain}'})"
    near = f"within {metric.negligible:g} {metric.unit} of the best"
    return f" ({near}{gain and f', which is {gain}'})"


def _gain_text(choices: Iterable[Choice], series: Series) -> str:
    """State the lead of the best width over doing nothing, as a range over the scenes."""
    metric = TASKS[series.task].metric
    gains = [choice.gain for choice in choices if choice.gain is not None]
    if not gains:
        return ""
    low, high = (metric.text(gain) for gain in (min(gains), max(gains)))
    return f"{low if low == high else f'{low} to {high}'} {metric.unit} better than doing nothing"


def _fewer_text(choices: list[Choice]) -> str:
    """State how many times fewer events than at the finest width, as a range over scenes."""
    savings = [saving for c in choices if (saving := c.saving(max(c.scores))) is not None]
    if not savings:
        return ""
    low, high = (times_text(value) for value in (min(savings), max(savings)))
    times = low if low == high else f"{low} to {high}"
    return f", with {times} times fewer events than {max(choices[0].scores)} px"


def times_text(ratio: float) -> str:
    """Format a ratio to two digits, or to whole numbers from 10 on."""
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:.0f}"
