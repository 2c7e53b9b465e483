"""The answer of a run in words: which resolution is enough, in which light and at which speed.

The report's headline, README and docs/results.md say it from here, in Markdown: `choose` says which
widths, `answered` of which conditions. The pages hold it between two comments, and

    python -m tasks.study.report.answer RUN PAGE...

writes it there anew.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from textwrap import fill

from eres_render.storage.atomic import write_bytes
from tasks.errors import ResultError, TaskError
from tasks.row import read_rows
from tasks.study.results.choice import Choice, Choices, answered, choose_all
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.paper import BASE_SPEED_M_PER_S
from tasks.study.results.perturbation import shown_series, sigma_mm
from tasks.study.results.scores import by_threshold
from tasks.study.results.words import MISSING, cutoff_label, join_words

_PAGE_WIDTH = 100
_BLOCK = re.compile(r"(<!-- answer: (\w+)\b.*?-->\n).*?(<!-- end of answer -->)", re.DOTALL)


def headline(choices: Choices, series: Series) -> str:
    """Say what is enough in the most and in the least light at the lowest speed, and in the least
    light at the highest; scenes are named where there are several."""
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
    """Say what is enough where; a run's only scene is not named, the sentence is all about it."""

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
    """How near to the best these are, and how good that is."""
    metric = METRICS[series.metric]
    gain = _gain_text(choices, series)
    if all(choice.enough == choice.best for choice in choices):
        return f" (the best{gain and f', {gain}'})"
    near = f"within {metric.negligible:g} {metric.unit} of the best"
    return f" ({near}{gain and f', which is {gain}'})"


def _gain_text(choices: Iterable[Choice], series: Series) -> str:
    """How much better the best width is than doing nothing, as a range over the scenes."""
    metric = METRICS[series.metric]
    gains = [choice.gain for choice in choices if choice.gain is not None]
    if not gains:
        return ""
    low, high = (metric.text(gain) for gain in (min(gains), max(gains)))
    return f"{low if low == high else f'{low} to {high}'} {metric.unit} better than doing nothing"


def _fewer_text(choices: list[Choice]) -> str:
    """How many times fewer events than at the finest width, as a range over the scenes."""
    savings = [saving for c in choices if (saving := c.saving(max(c.scores))) is not None]
    if not savings:
        return ""
    low, high = (times_text(value) for value in (min(savings), max(savings)))
    times = low if low == high else f"{low} to {high}"
    return f", with {times} times fewer events than {max(choices[0].scores)} px"


def times_text(ratio: float) -> str:
    """A ratio to two digits, and to whole ones."""
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:.0f}"


def overview(found: Mapping[Series, Choices]) -> str:
    """The headline of the first series, and a table with a line for each."""
    first, choices = next(iter(found.items()))
    lines = [(one, _scenes(choices)) for one, choices in found.items()]
    title = first.title[0].upper() + first.title[1:]
    said = [f"{title}. {headline(choices, first)}", _rule_text(found)]
    return "\n\n".join([*map(_wrapped, said), _table(found, lines)])


def details(found: Mapping[Series, Choices]) -> str:
    """A table with a line for each series and scene, with what the samples do not tell apart."""
    tied = (
        "In brackets, where it is smaller still, the smallest that the samples do not tell apart "
        "from the best (paired 95 % interval)."
    )
    lines = [(one, [scene]) for one, choices in found.items() for scene in _scenes(choices)]
    said = f"{_rule_text(found)} {tied}"
    return f"{_wrapped(said)}\n\n{_table(found, lines, tied=True)}"


BLOCKS = {"overview": overview, "details": details}


def _rule_text(found: Mapping[Series, Choices]) -> str:
    metrics = [METRICS[metric] for metric in dict.fromkeys(one.metric for one in found)]
    near = join_words([f"{metric.negligible:g} {metric.unit}" for metric in metrics], "or")
    text = (
        f"The smallest width, px, whose median is within {near} of the best, by light and speed. "
        '"None": even the best does not beat doing nothing by more than that.'
    )
    if any(choice and choice.paper for choices in found.values() for choice in choices.values()):
        text += (
            " *Paper*: the first rule on the medians that it prints, which come without a score of "
            "doing nothing."
        )
    speeds = {scene: BASE_SPEED_M_PER_S.get(scene) for c in found.values() for scene in _scenes(c)}
    stated = [f"{speed:g} m/s on {scene}" for scene, speed in speeds.items() if speed]
    return f"{text} Speed 1 is {join_words(stated)}." if stated else text


def _table(
    found: Mapping[Series, Choices], lines: list[tuple[Series, list[str]]], *, tied: bool = False
) -> str:
    """A Markdown table: series with their scenes down, conditions across, the paper beside ours."""
    conditions = list(dict.fromkeys(c for choices in found.values() for c in answered(choices)))
    heads, rows = [""], [[f"{one.title}, {' / '.join(scenes)}"] for one, scenes in lines]
    for cutoff, speed in conditions:
        at = [[found[one].get((scene, cutoff, speed)) for scene in s] for one, s in lines]
        label, hertz = cutoff_label(cutoff), f"{cutoff:g} Hz"
        light = label if math.isinf(cutoff) or label == hertz else f"{label}, {hertz}"
        heads.append(f"{light}, speed {speed:.2g}")
        for row, choices in zip(rows, at, strict=True):
            row.append(_joined([_width_text(choice, tied=tied) for choice in choices]))
        if any(choice and choice.paper for choices in at for choice in choices):
            heads.append("paper")
            for row, choices in zip(rows, at, strict=True):
                row.append(_joined([_paper_text(choice) for choice in choices]))
    rule = ["---"] * len(heads)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, rule, *rows))


def _width_text(choice: Choice | None, *, tied: bool) -> str:
    if choice is None:
        return MISSING
    if not choice.worthwhile:
        return "none"
    smaller = tied and choice.tied is not None and choice.tied < choice.enough
    return f"{choice.enough} ({choice.tied})" if smaller else str(choice.enough)


def _paper_text(choice: Choice | None) -> str:
    return str(choice.paper) if choice and choice.paper else MISSING


def _joined(texts: list[str]) -> str:
    """One text for all scenes if it is the same."""
    return texts[0] if len(set(texts)) == 1 else " / ".join(texts)


def _scenes(choices: Choices) -> list[str]:
    return list(dict.fromkeys(scene for scene, _, _ in choices))


def _wrapped(text: str) -> str:
    whole = text.replace(" px**", "\xa0px**")  # fill does not break lines there
    return fill(whole, _PAGE_WIDTH, break_on_hyphens=False).replace("\xa0", " ")


def choices_of(run_dir: Path) -> dict[Series, Choices]:
    """What a run chooses with each method on the usual variant of each task, by the first contrast
    threshold of its rows.

    Raises
    ------
    ResultError
        As `tasks.row.read_rows` and `tasks.study.results.scores.by_threshold` raise it.
    """
    scores = by_threshold(read_rows(run_dir / "rows.parquet"))[0]
    usual = [s for s in shown_series(scores) if not s.variant or sigma_mm(s.variant) is not None]
    return {series: choose_all(scores, series) for series in usual}


def with_answers(page: str, found: Mapping[Series, Choices]) -> str:
    """A page of Markdown with what stands between its comments made anew.

    Raises
    ------
    ResultError
        It has no such comments, or they ask for something else than `BLOCKS`.
    """
    expected = " or ".join(f"<!-- answer: {name} -->" for name in BLOCKS)
    if not (kinds := [block[2] for block in _BLOCK.finditer(page)]):
        raise ResultError(f"no place for an answer; expected {expected} … <!-- end of answer -->")
    for kind in kinds:
        if kind not in BLOCKS:
            raise ResultError(f"found <!-- answer: {kind} -->, expected {expected}")
    return _BLOCK.sub(lambda block: f"{block[1]}\n{BLOCKS[block[2]](found)}\n\n{block[3]}", page)


def main(arguments: Sequence[str]) -> None:
    """Write the answer of a run into pages."""
    if len(arguments) < 2:
        sys.exit("usage: python -m tasks.study.report.answer RUN PAGE...")
    run_dir, *pages = map(Path, arguments)
    try:
        found = choices_of(run_dir)
        for page in pages:
            write_bytes(page, _renewed(page, found).encode())
    except TaskError as error:
        sys.exit(f"error: {error}")


def _renewed(page: Path, found: Mapping[Series, Choices]) -> str:
    try:
        return with_answers(page.read_text(), found)
    except ResultError as error:
        raise ResultError(f"{page}: {error}") from None


if __name__ == "__main__":
    main(sys.argv[1:])
