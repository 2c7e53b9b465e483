"""What stands above all sections: the run in a line, and its answer to each task."""

from __future__ import annotations

from dataclasses import dataclass

from tasks.study.report.finished_run import FinishedRun
from tasks.study.results.answer import headline
from tasks.study.results.choice import Choices
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.metrics import METRICS, Series
from tasks.study.results.words import capitalized, join_words


@dataclass(frozen=True, slots=True)
class Answer:
    """The answer to one task, in Markdown."""

    title: str
    headline: str
    unit: str


@dataclass(frozen=True, slots=True)
class Summary:
    """What the page says first."""

    kicker: str
    answers: list[Answer]
    samples: str
    few_samples: bool
    thresholds: list[str]
    samples_needed: int = MIN_SAMPLES_FOR_INTERVAL


def summary(run: FinishedRun) -> Summary:
    """Collect the answer of the first method on each task, and how far to trust it."""
    scores = run.scores
    firsts: dict[str, Series] = {}
    for one in run.series:
        firsts.setdefault(one.task, one)
    counts = {scores.samples(one, s) for one in scores.series() for s in scores.scenes(one)}
    low, high = min(counts), max(counts)
    samples = f"{low if low == high else f'{low} to {high}'} sample{'s' * (high > 1)} a scene"
    parts = [
        f"eres {run.environment.get('eres', '')}".strip(),
        join_words(run.scenes),
        samples,
        f"contrast threshold {scores.contrast_threshold:g}",
    ]
    return Summary(
        kicker=" · ".join(parts),
        answers=[
            Answer(
                capitalized(one.title), headline(run.choices[one], one), METRICS[one.metric].unit
            )
            for one in firsts.values()
        ],
        samples=samples,
        few_samples=low < MIN_SAMPLES_FOR_INTERVAL,
        thresholds=[f"{one.contrast_threshold:g}" for one in run.found],
    )


def answer(choices: Choices, series: Series) -> Answer:
    """Say which width of one series is enough."""
    return Answer(capitalized(series.title), headline(choices, series), METRICS[series.metric].unit)
