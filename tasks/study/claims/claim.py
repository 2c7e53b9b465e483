"""Claims: what the paper says, and the numbers that confirm or contradict it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import islice

from tasks.metric import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.claims.numbers import (
    NotMeasured,
    Number,
    NumberText,
    Quantity,
    SceneScores,
    corrected,
    estimated,
)
from tasks.study.claims.statistics import SceneCell
from tasks.study.claims.verdict import Status, Verdict, status_of
from tasks.study.results.asked import Series
from tasks.study.results.intervals import TAILS, widening
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, paper_scores
from tasks.study.results.words import join_words


@dataclass(frozen=True, kw_only=True)
class Claim(ABC):
    """A claim in words. Subclasses judge it.

    `why` says what decides, in a sentence. `note` says how the paper is read where it contradicts
    itself, and what else a reader should know.
    """

    number: int
    title: str
    statement: str
    why: str = ""
    note: str = ""

    @abstractmethod
    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Judge the claim by a run's scores, and its scaling statistics by scene."""

    def verdict(
        self,
        outcomes: Iterable[Status],
        ours: str,
        paper: str,
        scope: str = "",
        likeness: str = "",
        intervals: int = 0,
    ) -> Verdict:
        """Return the verdict that follows from outcomes; texts and intervals as in `Verdict`."""
        note = f"{self.note} {scope}".strip()
        facts = self.number, self.title, self.statement, status_of(outcomes), ours, paper, note
        return Verdict(*facts, likeness, intervals, self.why)


@dataclass(frozen=True, kw_only=True)
class SceneClaim(Claim):
    """A claim about one method, judged scene by scene.

    Attributes
    ----------
    series
        The method, as `Scores` names it.
    numbers
        The numbers by name. Each `Number` with a bound decides.
    text
        Text of one scene, with the names of numbers in braces, for our numbers and the paper's.
    paper
        Text in place of the paper's numbers, if the paper prints none.
    scenes
        Scenes that the claim is about; () for all scenes of the run.
    beside
        Further series to print, each by its difference from `series`, such as {"method": "..."} or
        {"variant": "..."}. They show whether the claim would hold there, but do not decide it.
    beside_everywhere
        Whether these are printed on all scenes of the run, not only on those of the claim.
    mean
        Name of a number; its mean over the scenes is printed too.
    """

    series: Series
    numbers: Mapping[str, Quantity]
    text: str
    paper: str = ""
    scenes: tuple[str, ...] = ()
    beside: tuple[Mapping[str, str], ...] = ()
    beside_everywhere: bool = False
    mean: str = ""

    def chosen(self, scores: Scores) -> tuple[Series | None, str]:
        """Return the series to judge and a sentence about it, or None and the reason."""
        return self.series, ""

    def judge(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Verdict:
        """Judge the claim by its numbers on each scene.

        Parameters
        ----------
        scores, scaling
            As `Claim.judge` takes them.

        Returns
        -------
        Verdict
            It follows from one outcome for each scene that the claim is about.
        """
        published, lines = self._published
        unmeasured = Status.NOT_MEASURED
        measured = any(reading.status is not unmeasured for reading in published.values())
        paper = self.paper or ("\n".join(lines) if measured else "not reported")
        series, scope = self.chosen(scores)
        if series is None:
            return self.verdict((), scope, paper)
        readings, lines = self._read(scores, series, scaling)
        outcomes = [reading.status for reading in readings.values()]
        if status_of(outcomes) is not unmeasured:
            judged = [
                scene for scene, reading in readings.items() if reading.status is not unmeasured
            ]
            scope = f"{scope} {self._scope(scores, series, judged)}".strip()
        if not outcomes:
            where = f" on {join_words(self.scenes, 'or')}" if self.scenes else ""
            why = ", which is a network" if series.method in series.spec.networks else ""
            lines = [f"no rows of {series.name}{where}{why}", *lines]
        likeness = _likeness([reading.like_paper for reading in readings.values()])
        intervals = sum(reading.intervals for reading in readings.values())
        return self.verdict(outcomes, "\n".join(lines), paper, scope, likeness, intervals)

    @cached_property
    def _published(self) -> tuple[dict[str, NumberText], list[str]]:
        return self._read(paper_scores(), self.series, {})

    def _read(
        self, scores: Scores, series: Series, scaling: Mapping[str, Scaling]
    ) -> tuple[dict[str, NumberText], list[str]]:
        """Read the numbers of each scene, and return them with lines of text."""
        lines = []
        others = [series._replace(**change) for change in self.beside]
        scenes = dict.fromkeys(scene for each in (series, *others) for scene in scores.scenes(each))
        every = [SceneScores(scores, series, scene, scaling.get(scene)) for scene in scenes]
        claimed = [on for on in every if not self.scenes or on.scene in self.scenes]
        judged = [on for on in claimed if on.scene in scores.scenes(series)]
        readings = self._readings(judged)
        for on in every if self.beside_everywhere else claimed:
            if reading := readings.get(on.scene):
                fails = reading.status is Status.DOES_NOT_HOLD
                lines.append(f"{on.scene}: {reading.text}{' (does not hold)' * fails}")
            for other in others:
                with suppress(NotMeasured):
                    reading = self._reading(self._numbers(replace(on, series=other)))
                    lines.append(f"{on.scene}, {other.name}: {reading.text} ({reading.status})")
        return readings, lines + self._mean(judged)

    def _readings(self, every: Sequence[SceneScores]) -> dict[str, NumberText]:
        """Read the numbers of all scenes, which fail together, and judge each scene by its own."""
        readings, numbers_of = {}, {}
        for on in every:
            try:
                numbers_of[on.scene] = self._numbers(on)
            except NotMeasured as reason:
                readings[on.scene] = NumberText(str(reason), Status.NOT_MEASURED)
        numbers = iter(
            corrected([number for of_scene in numbers_of.values() for number in of_scene])
        )
        for scene, of_scene in numbers_of.items():
            readings[scene] = self._reading([*islice(numbers, len(of_scene))])
        return {on.scene: readings[on.scene] for on in every}

    @property
    def _cells(self) -> list[SceneCell]:
        """The cells that the numbers come from."""
        numbers = [number for number in self.numbers.values() if isinstance(number, Number)]
        cells = {cell for number in numbers for cell in number.statistic.cells}
        return sorted(cells, key=lambda c: (c.method, c.width, -c.cutoff_hz, c.speed))

    def _numbers(self, on: SceneScores) -> list[NumberText]:
        """Read the numbers of a scene."""
        on.require(self._cells)
        return [read(on) for read in self.numbers.values()]

    def _reading(self, numbers: Sequence[NumberText]) -> NumberText:
        """Judge a scene by its numbers."""
        texts = zip(self.numbers, (number.text for number in numbers), strict=True)
        compared = [number.like_paper for number in numbers if number.like_paper is not None]
        return NumberText(
            self.text.format_map(dict(texts)),
            status_of(number.status for number in numbers),
            all(compared) if compared else None,
            intervals=sum(number.fails_at is not None for number in numbers),
        )

    def _mean(self, every: Sequence[SceneScores]) -> list[str]:
        """Return a line with the mean over the scenes, if several have the number."""
        number = self.numbers.get(self.mean)
        if not isinstance(number, Number):
            return []
        complete = [on for on in every if all(on.cell(c).complete for c in number.statistic.cells)]
        if len(complete) < 2:
            return []
        with suppress(NotMeasured):
            mean = number.text_of(estimated(number.statistic, *complete), complete[0].metric)
            return [f"mean of {len(complete)} scenes: {mean}"]
        return []

    def _scope(self, scores: Scores, series: Series, judged: Sequence[str]) -> str:
        """Name the scenes if some are missing, and the samples if they are few."""
        claimed = self.scenes or paper_scores().scenes(self.series)
        few = min(scores.samples(series, scene) for scene in judged) if self._cells else None
        seeds = min(scores.seeds(series, scene) for scene in judged)
        return scope_text(judged if set(claimed) - set(judged) else (), few, seeds)


def _likeness(scenes: Iterable[bool | None]) -> str:
    """Say on how many scenes all numbers are like the paper's; None if they have no number."""
    compared = [like_paper for like_paper in scenes if like_paper is not None]
    if not compared:
        return ""
    if len(compared) == 1:
        return "numbers like the paper's" if compared[0] else "numbers unlike the paper's"
    return f"numbers like the paper's on {sum(compared)} of {len(compared)} scenes"


def scope_text(only: Collection[str] = (), samples: int | None = None, seeds: int = 1) -> str:
    """Say which scenes and samples a verdict is based on, if some are missing.

    `samples` and `seeds` are numbers of the scene with the fewest; `samples` is None if it does not
    matter.
    """
    parts = [f"Judged on {join_words([*only])} only"] if only else []
    if samples is not None and samples < MIN_SAMPLES_FOR_INTERVAL:
        few = f"{samples} sample{'s' * (samples != 1)}"
        parts.append(f"{few}, too few for an interval ({MIN_SAMPLES_FOR_INTERVAL} needed)")
    if seeds > 1:
        wider = widening(seeds, TAILS[0])
        parts.append(
            f"{seeds} seeds of each scene, so few that intervals are {wider:.1f} times wider"
        )
    return f"{'; '.join(parts)}." if parts else ""
