"""What a claim is: words, and the numbers that uphold or contradict it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

from tasks.study.claims.numbers import (
    NotMeasured,
    Number,
    Quantity,
    Reading,
    SceneScores,
    estimated,
)
from tasks.study.results.intervals import MIN_SAMPLES_FOR_INTERVAL
from tasks.study.results.metrics import Series
from tasks.study.results.scaling import Scaling
from tasks.study.results.scores import Scores, paper_scores
from tasks.study.results.words import join_words


@dataclass(frozen=True, slots=True)
class Evidence:
    """What the scores of a run say about a claim.

    Attributes
    ----------
    outcomes
        Whether the claim holds in each place where it is judged; None where it is not measured.
    ours, paper
        Our numbers and the paper's, a line per scene; or what is missing.
    scope
        What the numbers rest on, in words; "" where it is what the paper's rest on.
    """

    outcomes: Sequence[bool | None]
    ours: str
    paper: str
    scope: str


@dataclass(frozen=True, kw_only=True)
class Claim(ABC):
    """What the paper says, in words; a subclass finds the evidence.

    Attributes
    ----------
    note
        What is judged, and which reading of the paper where it contradicts itself.
    """

    number: int
    title: str
    statement: str
    note: str = ""

    @abstractmethod
    def evidence(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Evidence:
        """Return what a run says about the claim.

        Parameters
        ----------
        scores
            The run's scores.
        scaling
            Its scaling statistics by scene.

        Returns
        -------
        Evidence
            Outcomes, and numbers in words.
        """


@dataclass(frozen=True, kw_only=True)
class SceneClaim(Claim):
    """A claim about one method, judged scene by scene.

    Attributes
    ----------
    series
        The method.
    numbers
        The numbers that decide or that are printed, by name.
    ours, paper
        Text of a scene, with the names of numbers in braces. A text of the paper without any is
        printed as it is.
    scenes
        The scenes that the claim is about; all of the run if empty.
    beside
        Other methods of the task whose numbers are printed too, where a run has them, each with its
        text. They do not decide.
    mean
        Name of the number to print as a mean over scenes too.
    of_samples
        Whether the numbers are medians over samples, which can be too few for an interval.
    """

    series: Series
    numbers: Mapping[str, Quantity]
    ours: str
    paper: str
    scenes: tuple[str, ...] = ()
    beside: Mapping[str, str] = field(default_factory=dict)
    mean: str = ""
    of_samples: bool = True

    def chosen(self, scores: Scores) -> tuple[Series | None, str]:
        """Return the series of a run that is judged and words about it, or None and why not."""
        return self.series, ""

    def evidence(self, scores: Scores, scaling: Mapping[str, Scaling]) -> Evidence:
        """Read the numbers of each scene."""
        series, about = self.chosen(scores)
        if series is None:
            return Evidence((), about, self._paper(), "")
        outcomes: dict[str, bool | None] = {}
        lines = []
        for scene in self._of_claim(scores.scenes(series)):
            on = SceneScores(scores, series, scene, scaling.get(scene))
            try:
                readings = self._readings(on)
            except NotMeasured as reason:
                outcomes[scene] = None
                lines.append(f"{scene}: {reason}")
                continue
            outcomes[scene] = all(reading.holds for reading in readings.values())
            first, *more = self.ours.format_map(readings).split("\n")
            failed = "" if outcomes[scene] else " (does not hold)"
            lines += [f"{scene}: {first}{failed}", *more, *self._beside(on)]
        where = f" on {join_words(self.scenes, 'or')}" if self.scenes else ""
        lines = lines or [f"no rows of {series.name}{where}"]
        lines += self._mean(scores, series, "mean of {} scenes")
        judged = [scene for scene, holds in outcomes.items() if holds is not None]
        scope = f"{about} {self._scope(scores, series, judged)}".strip()
        return Evidence(list(outcomes.values()), "\n".join(lines), self._paper(), scope)

    def _of_claim(self, scenes: Iterable[str]) -> list[str]:
        return [scene for scene in scenes if not self.scenes or scene in self.scenes]

    def _readings(self, on: SceneScores) -> dict[str, Reading]:
        numbers = [one for one in self.numbers.values() if isinstance(one, Number)]
        cells = {cell for number in numbers for cell in number.statistic.cells}
        on.require(sorted(cells, key=lambda c: (c.method, c.width, -c.cutoff_hz, c.speed)))
        return {name: read(on) for name, read in self.numbers.items()}

    def _beside(self, on: SceneScores) -> list[str]:
        lines = []
        for method, text in self.beside.items():
            with suppress(NotMeasured):
                other = replace(on, series=on.series._replace(method=method))
                lines.append(text.format_map(self._readings(other)))
        return lines

    def _paper(self) -> str:
        if "{" not in self.paper:
            return self.paper
        scores = paper_scores()
        lines = []
        for scene in self._of_claim(scores.scenes(self.series)):
            with suppress(NotMeasured):
                readings = self._readings(SceneScores(scores, self.series, scene))
                lines.append(f"{scene}: {self.paper.format_map(readings)}")
        return "\n".join(lines + self._mean(scores, self.series, "mean")) or "not reported"

    def _mean(self, scores: Scores, series: Series, label: str) -> list[str]:
        """A line with the mean of the named number over the scenes that have it, if several do."""
        number = self.numbers.get(self.mean)
        if not isinstance(number, Number):
            return []
        every = [SceneScores(scores, series, scene) for scene in scores.scenes(series)]
        found = [on for on in every if all(on.cell(c).complete for c in number.statistic.cells)]
        if len(found) < 2:
            return []
        unit = found[0].metric.unit
        mean = estimated(number.statistic, *found)
        return [f"{label.format(len(found))}: {mean.text(unit=unit)}"]

    def _scope(self, scores: Scores, series: Series, judged: Sequence[str]) -> str:
        """Say what the verdict rests on, where that is less than the paper's."""
        if not judged:
            return ""
        claimed = self.scenes or paper_scores().scenes(self.series)
        parts = [f"Judged on {join_words(judged)} only"] if set(claimed) - set(judged) else []
        few = min(scores.samples(series, scene) for scene in judged)
        if self.of_samples and few < MIN_SAMPLES_FOR_INTERVAL:
            parts.append(too_few_text(few))
        return f"{'; '.join(parts)}." if parts else ""


def too_few_text(samples: int) -> str:
    """Say that these are too few samples for an interval."""
    plural = "sample" if samples == 1 else "samples"
    return f"{samples} {plural}, too few for an interval ({MIN_SAMPLES_FOR_INTERVAL} needed)"
