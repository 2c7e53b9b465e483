"""What a finished run holds: its scores, and what follows from them, each worked out once."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError
from tasks.row import read_rows
from tasks.study.claims.judge import judge_all
from tasks.study.claims.verdict import Verdict
from tasks.study.results.choice import Choices, choose_all
from tasks.study.results.metrics import Series
from tasks.study.results.perturbation import shown_series
from tasks.study.results.scaling import Scaling, read_scaling
from tasks.study.results.scores import Scores, by_threshold


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run, as sections of the report take it.

    Attributes
    ----------
    folder
        Where its files lie.
    found
        Scores of each contrast threshold; the report is about the first.
    environment
        Where and how it was computed, by name.
    config
        The resolved study.
    """

    folder: Path
    found: Sequence[Scores]
    environment: Mapping[str, str]
    config: Mapping[str, Any]

    @property
    def scores(self) -> Scores:
        """Scores of the first contrast threshold."""
        return self.found[0]

    @cached_property
    def series(self) -> list[Series]:
        """The series that are shown, by task."""
        return shown_series(self.scores)

    @cached_property
    def scenes(self) -> list[str]:
        """Scenes of any series, in the order of the rows."""
        return list(
            dict.fromkeys(s for one in self.scores.series() for s in self.scores.scenes(one))
        )

    @property
    def firsts(self) -> list[Series]:
        """The first series of each task."""
        return list({one.task: one for one in reversed(self.series)}.values())[::-1]

    @cached_property
    def sample_counts(self) -> list[int]:
        """The different numbers of samples a scene, ascending."""
        scores = self.scores
        return sorted({scores.samples(s, at) for s in scores.series() for at in scores.scenes(s)})

    @cached_property
    def choices(self) -> dict[Series, Choices]:
        """Which width to choose, by series."""
        return {one: choose_all(self.scores, one) for one in self.series}

    @cached_property
    def scaling(self) -> dict[str, Scaling]:
        """Scaling statistics by scene."""
        return read_scaling(self.folder / "scaling")

    @cached_property
    def verdicts(self) -> list[Verdict]:
        """The paper's claims, judged."""
        return judge_all(self.scores, self.scaling)

    def picture(self, name: str, reason: str) -> str:
        """Read a PNG file in base64; `reason` says why it is expected.

        Parameters
        ----------
        name
            Its path in the run's folder.
        reason
            Ends the error's text.

        Returns
        -------
        str
            Its bytes in base64.

        Raises
        ------
        ResultError
            It is missing.
        """
        path = self.folder / name
        try:
            return base64.b64encode(path.read_bytes()).decode()
        except FileNotFoundError:
            raise ResultError(f"{path}: no such file, but {reason}") from None


def read_run(folder: Path) -> FinishedRun:
    """Read the folder of a finished run.

    Raises
    ------
    ResultError
        A file is missing or damaged, or the rows hold no method but doing nothing.
    """
    rows_file = folder / "rows.parquet"
    found = by_threshold(read_rows(rows_file))
    environment = read_json(dict[str, str], folder / "environment.json", ResultError)
    config = read_json(dict[str, Any], folder / "study.json", ResultError)
    if not found[0].series():
        raise ResultError(f"{rows_file}: only do-nothing rows, no method to report on")
    return FinishedRun(folder, found, environment, config)
