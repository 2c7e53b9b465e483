"""Write into Markdown pages which resolution is enough, and how many claims hold.

    python docs/answers.py RUN PAGE...

replaces the text between two comments in each page. The answers in README.md and docs/results.md
are those of docs/results/paper, those in docs/chip.md of docs/results/chip.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from textwrap import fill

from scipy.stats import spearmanr

from eres_render.errors import RenderError, reading
from eres_render.scene.scene import name_and_seed
from eres_render.storage.atomic import write_text
from tasks.errors import ResultError, TaskError
from tasks.registry import TASKS, sigma_mm
from tasks.row import Row, read_rows
from tasks.study.claims.judge import changed_verdicts
from tasks.study.claims.verdict import Status, Verdict, status_of
from tasks.study.report.finished_run import FinishedRun, read_run
from tasks.study.report.sections.photoreceptor import leads
from tasks.study.results.asked import Condition, MetersPerSecond, Series, lux_of
from tasks.study.results.choice import (
    Choice,
    Choices,
    answered,
    choose_all,
    designs_of,
    width_in_design,
)
from tasks.study.results.perturbation import is_main
from tasks.study.results.scores import Scores, by_photoreceptor
from tasks.study.results.words import (
    MISSING,
    PACKAGED,
    BaseSpeeds,
    cutoff_label,
    join_words,
    photoreceptor_label,
    speed_label,
)

_PAGE_WIDTH = 100
PAPER = Path(__file__).parent / "results" / "paper"
EXACT = "two_pole"
_ALL = "all"
_BLOCK = re.compile(r"(<!-- answer: (\w+)\b.*?-->\n).*?(<!-- end of answer -->)", re.DOTALL)


def overview(chosen: Mapping[Series, Choices], base: BaseSpeeds = PACKAGED) -> str:
    """Return a table with one line per series."""
    lines = [(series, _scenes(choices)) for series, choices in chosen.items()]
    return f"{_wrapped(_rule_text(chosen, base))}\n\n{_table(chosen, lines)}"


def details(chosen: Mapping[Series, Choices], base: BaseSpeeds = PACKAGED) -> str:
    """Return a table with one line per series and scene, including ties in brackets."""
    tied = (
        "In brackets: an even smaller width, if the samples do not separate it from the best "
        "(paired 95 % interval)."
    )
    lines = [(series, [scene]) for series, choices in chosen.items() for scene in _scenes(choices)]
    text = f"{_rule_text(chosen, base)} {tied}"
    return f"{_wrapped(text)}\n\n{_table(chosen, lines, tied=True)}"


def claim_counts(judged: Mapping[str, Sequence[Verdict]]) -> str:
    """Return how many claims hold, which, and what changes with another photoreceptor."""
    verdicts = next(iter(judged.values()))
    measured = [verdict for verdict in verdicts if verdict.status in _WORDS]
    if not measured:
        return "None of the paper's claims is about this run."
    parts: dict[int, list[Status]] = {}  # of claims, by their number
    for verdict in measured:
        parts.setdefault(verdict.number, []).append(verdict.status)
    by_status: dict[Status, list[str]] = {status: [] for status in _WORDS}
    for number, statuses in parts.items():
        by_status[status_of(statuses)].append(str(number))
    counts = [_counted(status, numbers) for status, numbers in by_status.items()]
    text = f"Of {len(parts)} claims that this run measures, {join_words(counts)}."
    for name in [*judged][1:]:
        changed = changed_verdicts({"": verdicts, name: judged[name]})
        named = [f"{verdict.number} {_WORDS[verdict.status][0]}" for _, verdict in changed]
        changes = "no verdict changes"
        if named:
            changes = f"only these verdicts change: {join_words(named)}"
        text += f" With {photoreceptor_label(name)}, {changes}."
    return _wrapped(text)


def claim_list(judged: Mapping[str, Sequence[Verdict]]) -> str:
    """Return a table of the claims that a run measures: verdict, and what decides. Where another
    photoreceptor changes the verdict, that is in brackets."""
    first, *others = judged
    columns: list[list[str]] = [[""], ["claim"], ["verdict"], ["why"]]
    missing: dict[str, None] = {}
    for k, claim in enumerate(judged[first]):
        if claim.status is Status.NOT_MEASURED:
            missing[str(claim.number)] = None
            continue
        changed = {
            name: status for name in others if (status := judged[name][k].status) != claim.status
        }
        texts = [f"{photoreceptor_label(name)}: {status}" for name, status in changed.items()]
        verdict = f"{claim.status} ({'; '.join(texts)})" if texts else str(claim.status)
        for column, text in zip(
            columns, (str(claim.number), claim.title, verdict, claim.why), strict=True
        ):
            column.append(text)
    table = _markdown(columns)
    return f"{table}\n\nNot measured: {join_words([*missing])}." if missing else table


def sample_worth(run: FinishedRun) -> str:
    """Return how many independent samples those of each scene are worth, a line for each task."""
    reading = run.scores.photoreceptor
    every = {series: leads({reading: run.scores}, series) for series in run.firsts}
    first = {series: leads_of_one[0] for series, leads_of_one in every.items() if leads_of_one}
    if not first:
        return "This run compares no two sensors behind a photoreceptor."
    at = max(lead.cutoff_hz for lead in first.values()), min(lead.speed for lead in first.values())
    worth = {
        (series, place.scene): lead.effective_samples
        for series, leads_of_one in every.items()
        for place in leads_of_one
        if (place.cutoff_hz, place.speed) == at and (lead := place.intervals[reading])
    }
    columns = [["", *(series.title for series in first)]]
    for scene in run.scenes:
        of_scene = [
            (worth.get((series, scene)), run.scores.samples(series, scene)) for series in first
        ]
        columns.append([scene, *(f"{n:.2g} of {count}" if n else MISSING for n, count in of_scene)])
    fine, coarse = (sensor.label for sensor in next(iter(first.values())).sensors)
    text = (
        "Intervals take the samples of a scene as independent. By the correlation of neighbors on "
        f"the path they are worth fewer. For the lead of {fine} over {coarse}, "
        f"{_light_text(at[0])}, {speed_label('', at[1])}:"
    )
    return f"{_wrapped(text)}\n\n{_markdown(columns)}"


def ranks(run: FinishedRun) -> str:
    """Return how our medians are ordered beside the paper's, a line for each method that it has."""
    columns: list[list[str]] = [[""], *([scene] for scene in run.scenes)]
    for series in filter(is_main, run.series):
        of_series = []
        for scene in run.scenes:
            at = run.scores.conditions(series, scene)
            pairs = [
                (run.scores.cell(series, w).median, run.scores.published(series, w)) for w in at
            ]
            both = [pair for pair in pairs if None not in pair]
            rank = f"{spearmanr(both).statistic:.2f} of {len(both)}" if len(both) > 2 else MISSING
            of_series.append(rank)
        label = TASKS[series.task].label(series.method)
        if {*of_series} != {MISSING}:
            for column, cell in zip(columns, [label, *of_series], strict=True):
                column.append(cell)
    return _markdown(columns)


def medians(run: FinishedRun) -> str:
    """Return the median scores of each main method, a line for each scene, light and speed that the
    answers have, and a column for each sensor; the best is bold."""
    scores, main = run.scores, [*filter(is_main, run.series)]
    sensors = sorted({sensor for series in main for sensor in scores.sensors(series)})
    columns: list[list[str]] = [[""], *([sensor.label] for sensor in sensors)]
    for series in main:
        metric = TASKS[series.task].metric
        for scene in scores.scenes(series):
            for cutoff_hz, speed in answered(choose_all(scores, series)):
                at = f"{_light_text(cutoff_hz)}, {speed_label('', speed)}"
                places = [Condition(scene, s.width, cutoff_hz, speed, s.name) for s in sensors]
                ours = [scores.cell(series, place).median for place in places]
                known = [metric.sign * value for value in ours if value is not None]
                if not known:
                    continue
                texts = [MISSING if v is None else metric.text(v) for v in ours]
                best = [v is not None and metric.sign * v == max(known) for v in ours]
                bold = [f"**{t}**" if b else t for t, b in zip(texts, best, strict=True)]
                label = f"{TASKS[series.task].label(series.method)}, {scene}, {at}"
                for column, text in zip(columns, [label, *bold], strict=True):
                    column.append(text)
    return _markdown(columns)


def designs(run: FinishedRun) -> str:
    """Return the choice of a width for each design of a chip, a line for each method and scene."""
    scores = run.scores
    lines: dict[str, dict[str, list[str]]] = {}
    for series in filter(is_main, run.series):
        for design, others in designs_of(scores.sensors(series)).items():
            bus = design.partition(", ")[2]
            for (scene, cutoff_hz, speed), choice in choose_all(scores, series, others).items():
                line = f"{TASKS[series.task].label(series.method)}, {scene}{bus and ', '}{bus}"
                lux = lux_of(cutoff_hz)
                light = f"{lux:.0f} lux" if lux else cutoff_label(cutoff_hz)
                at = f"{light}, {speed_label('', speed)}"
                enough = choice and (
                    width_in_design(choice.enough) if choice.worthwhile else "none"
                )
                text = (enough or MISSING).removesuffix(" px")
                lines.setdefault(line, {}).setdefault(at, []).append(text)
    columns = [["", *lines]]
    for at in dict.fromkeys(at for of_line in lines.values() for at in of_line):
        columns.append([at, *(_joined(of_line.get(at, [MISSING])) for of_line in lines.values())])
    return _markdown(columns)


def programs(run: FinishedRun) -> str:
    """Return the lead of the finest sensor with each photoreceptor or program, beside the paper's,
    a line for each method, scene, light and speed that the answers have.

    A run of programs alone has the exact pixels of docs/results/paper beside it, on its samples.
    """
    readings = run.readings
    if EXACT not in readings:
        of_run = {(row.scene, row.sample) for row in read_rows(run.folder / "rows.parquet")}
        papers = read_rows(PAPER / "rows.parquet")
        exact = by_photoreceptor(row for row in papers if (row.scene, row.sample) in of_run)
        readings = {EXACT: exact[EXACT][0], **readings}
    return _leads_table(run, readings, {name: _program_text(name) for name in readings})


def seeds(run: FinishedRun) -> str:
    """Return the lead of the finest sensor on each seed of the scenes and on all of them, beside
    the paper's; lines are as in `programs`."""
    of_seed: dict[int, list[Row]] = {}
    for row in read_rows(run.folder / "rows.parquet"):
        of_seed.setdefault(name_and_seed(row.scene)[1], []).append(row)
    readings = {str(seed): Scores(of_seed[seed]) for seed in sorted(of_seed)}
    heads = {name: f"seed {name}" for name in readings} | {_ALL: "all"}
    return _leads_table(run, {**readings, _ALL: run.scores}, heads)


def _leads_table(run: FinishedRun, readings: Mapping[str, Scores], heads: Mapping[str, str]) -> str:
    """Return leads with each reading and the paper's, with the interval of a reading `_ALL`."""
    lines: dict[str, list[str]] = {"": [*heads.values(), "paper"]}
    for series in filter(is_main, run.series):
        metric, shown = TASKS[series.task].metric, answered(choose_all(run.scores, series))
        for lead in leads(readings, series):
            if (lead.cutoff_hz, lead.speed) not in shown:
                continue
            at = f"{cutoff_label(lead.cutoff_hz)}, {speed_label('', lead.speed)}"
            values = [
                None if interval is None else interval.value for interval in lead.intervals.values()
            ]
            texts = [MISSING if v is None else metric.text(v, "+") for v in (*values, lead.paper)]
            of_all = lead.intervals.get(_ALL)
            if of_all and of_all.low is not None and of_all.high is not None:
                ends = metric.text(of_all.low, "+"), metric.text(of_all.high, "+")
                texts[-2] += f" [{', '.join(ends)}]"
            lines[f"{TASKS[series.task].label(series.method)}, {lead.scene}, {at}"] = texts
    return _markdown([*zip(*([name, *texts] for name, texts in lines.items()), strict=True)])


def program_verdicts(run: FinishedRun) -> str:
    """Return the verdict on each claim with each program, a line for each claim."""
    judged = run.verdicts_by_photoreceptor
    columns = [["", *map(_program_text, judged)]]
    for of_claim in zip(*judged.values(), strict=True):
        statuses = [verdict.status for verdict in of_claim]
        if {*statuses} <= {Status.NOT_MEASURED, Status.NO_VERDICT}:
            continue
        texts = [MISSING if status is Status.NOT_MEASURED else str(status) for status in statuses]
        columns.append([f"{of_claim[0].number} {of_claim[0].title}", *texts])
    return _markdown([*zip(*columns, strict=True)])


def _program_text(name: str) -> str:
    """Name a photoreceptor, or the version and the step of v2e's program."""
    return photoreceptor_label(name).removeprefix("v2e ").removesuffix(" a frame")


# The verb after one claim, and after several.
_WORDS = {
    Status.HOLDS: ("holds", "hold"),
    Status.DOES_NOT_HOLD: ("does not", "do not"),
    Status.UNDECIDED: ("is undecided", "are undecided"),
}


def _counted(status: Status, numbers: Sequence[str]) -> str:
    singular, plural = _WORDS[status]
    if not numbers:
        return f"none {singular}"
    return f"{len(numbers)} {plural if numbers[1:] else singular} ({', '.join(numbers)})"


def _rule_text(chosen: Mapping[Series, Choices], base: BaseSpeeds) -> str:
    metrics = dict.fromkeys(TASKS[series.task].metric for series in chosen)
    near = join_words([metric.near for metric in metrics], "or")
    text = (
        f"The smallest width in px with a median within {near} of the best, by light and speed. "
        '"None": even the best width does not beat doing nothing by more than this margin. '
        "A single entry in a row with several scenes holds for all of them."
    )
    if any(choice and choice.paper for choices in chosen.values() for choice in choices.values()):
        text += (
            " *Paper*: the same rule on the paper's medians, not compared with doing nothing; "
            "a dash means no numbers."
        )
    factors = {
        where[0]: None
        for choices in chosen.values()
        for where in choices
        if not isinstance(where[2], MetersPerSecond)
    }
    stated = [f"{speed_label(scene, 1.0, base)} on {scene}" for scene in factors if base.get(scene)]
    return f"{text} Speed 1 is {join_words(stated)}." if stated else text


def _table(
    chosen: Mapping[Series, Choices], lines: list[tuple[Series, list[str]]], *, tied: bool = False
) -> str:
    """Return a Markdown table: series as rows; conditions, ours and the paper's, as columns."""
    conditions = list(dict.fromkeys(c for choices in chosen.values() for c in answered(choices)))
    columns = [["", *(f"{series.title}, {' / '.join(scenes)}" for series, scenes in lines)]]
    for cutoff, speed in conditions:
        at = [[chosen[series].get((scene, cutoff, speed)) for scene in s] for series, s in lines]
        ours = [_joined([_width_text(choice, tied=tied) for choice in choices]) for choices in at]
        columns.append([f"{_light_text(cutoff)}, {speed_label('', speed)}", *ours])
        if any(choice and choice.paper for choices in at for choice in choices):
            columns.append(["paper", *(_joined([*map(_paper_text, choices)]) for choices in at)])
    return _markdown(columns)


def _light_text(cutoff_hz: float) -> str:
    label, hertz = cutoff_label(cutoff_hz), f"{cutoff_hz:g} Hz"
    return label if math.isinf(cutoff_hz) or label == hertz else f"{label}, {hertz}"


def _markdown(columns: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table of columns, whose first texts are the headings."""
    heads, *rows = zip(*columns, strict=True)
    rule = ["---"] * len(columns)
    lines = ([cell.replace("|", r"\|") for cell in cells] for cells in (heads, rule, *rows))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _width_text(choice: Choice | None, *, tied: bool) -> str:
    if choice is None:
        return MISSING
    if not choice.worthwhile:
        return "none"
    return f"{choice.enough} ({choice.tied})" if tied and choice.tied else str(choice.enough)


def _paper_text(choice: Choice | None) -> str:
    return str(choice.paper) if choice and choice.paper else MISSING


def _joined(texts: list[str]) -> str:
    """Join the texts of all scenes; equal texts become one."""
    return texts[0] if len(set(texts)) == 1 else " / ".join(texts)


def _scenes(choices: Choices) -> list[str]:
    return list(dict.fromkeys(scene for scene, _, _ in choices))


def _wrapped(text: str) -> str:
    return fill(text, _PAGE_WIDTH, break_on_hyphens=False)


ANSWERS: Mapping[str, Callable[[FinishedRun], str]] = {
    "overview": lambda run: overview(_choices_of(run), run.base_speeds),
    "details": lambda run: details(_choices_of(run), run.base_speeds),
    "claims": lambda run: claim_counts(run.verdicts_by_photoreceptor),
    "verdicts": lambda run: claim_list(run.verdicts_by_photoreceptor),
    "samples": sample_worth,
    "ranks": ranks,
    "medians": medians,
    "designs": designs,
    "programs": programs,
    "seeds": seeds,
    "program_verdicts": program_verdicts,
}
"""The texts that a page can have about a run.

Widths are those of each method on the default variant of each task. Only rows of the first
photoreceptor and contrast threshold count.
"""


def _choices_of(run: FinishedRun) -> dict[Series, Choices]:
    usual = [s for s in run.series if not s.variant or sigma_mm(s.variant) is not None]
    return {series: choose_all(run.scores, series) for series in usual}


def with_answers(page: Path, run: FinishedRun) -> str:
    """Replace the text between the comments of a Markdown page."""
    expected = join_words([f"<!-- answer: {name} -->" for name in ANSWERS], "or")
    with reading(page, "a Markdown page", ResultError):
        text = page.read_text(encoding="utf-8")
    if not (kinds := [block[2] for block in _BLOCK.finditer(text)]):
        raise ResultError(
            f"{page}: found no answer block, expected {expected} … <!-- end of answer -->"
        )
    for kind in kinds:
        if kind not in ANSWERS:
            raise ResultError(f"{page}: found <!-- answer: {kind} -->, expected {expected}")
    return _BLOCK.sub(lambda block: f"{block[1]}\n{ANSWERS[block[2]](run)}\n\n{block[3]}", text)


def main(arguments: Sequence[str]) -> None:
    """Write the answers of a run into Markdown pages."""
    if len(arguments) < 2:
        sys.exit("usage: python docs/answers.py RUN PAGE...")
    run_dir, *pages = map(Path, arguments)
    try:
        run = read_run(run_dir)
        for page in pages:
            write_text(page, with_answers(page, run))
    except (TaskError, RenderError) as error:
        sys.exit(f"error: {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
