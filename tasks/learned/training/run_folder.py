"""The folder of a training: its settings and its learning curve."""

from __future__ import annotations

import csv
import io
import json
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eres_render.storage.atomic import clear_unfinished, write_text
from eres_render.storage.locks import LockedError, locked
from eres_render.storage.settings_reader import differences, read_json
from tasks.errors import TrainingError
from tasks.provenance import together

SETTINGS_FILE, CURVE_FILE, PICTURE_FILE = "training.json", "curve.csv", "curve.png"
CHECKPOINT_FILE, WEIGHTS_FILE, SCORES_FILE = "checkpoint.pt", "weights.pt", "scores.json"

_TRAINED = WEIGHTS_FILE, CHECKPOINT_FILE  # what a training leaves, besides its settings

_logger = logging.getLogger(__name__)

Row = dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FinalScores:
    """The content of scores.json.

    Parameters
    ----------
    scores
        Mean scores on the held-out crops by light: of the network, then of each baseline.
    seconds
        Time that the training took, s.
    """

    score: str
    baselines: tuple[str, ...]
    scores: dict[str, tuple[float, ...]]
    seconds: float
    steps: int
    device: str

    def __post_init__(self) -> None:
        counts = {light: len(scores) for light, scores in self.scores.items()}
        expected = 1 + len(self.baselines)
        if {*counts.values()} != {expected}:
            raise TrainingError(
                f"scores: found {counts} numbers, expected {expected} for each light: one for the "
                "network and one for each baseline"
            )


@dataclass(frozen=True, slots=True)
class Description:
    """The content of training.json: the settings and the origin of a training."""

    settings: dict[str, Any]
    made_with: dict[str, str]

    def __post_init__(self) -> None:
        for name in ("task", "light", "seed"):
            if name not in self.settings:
                raise TrainingError(f"settings.{name}: missing; each training has it")


@contextmanager
def opened(
    folder: Path, settings: Mapping[str, Any], made_with: Mapping[str, str]
) -> Iterator[None]:
    """Create or continue the folder of a training, locked against other processes.

    Parameters
    ----------
    made_with
        Code, machine and versions of this start; those of earlier ones that left a checkpoint are
        kept next to them.
    """
    file = folder / SETTINGS_FILE
    try:
        with locked(folder / ".lock", wait=False):
            clear_unfinished(folder)
            if file.exists():
                _check_same(file, settings)
                if not (folder / WEIGHTS_FILE).exists():  # a finished training is only read
                    made_with = _with_earlier_starts(folder, made_with)
                    _write(file, read_description(folder).settings, made_with)
            elif untold := [name for name in _TRAINED if (folder / name).exists()]:
                raise TrainingError(
                    f"{file}: is missing, so the settings of {untold[0]} are unknown; choose "
                    "another folder"
                )
            else:
                _write(file, settings, made_with)
            yield
    except LockedError:
        raise TrainingError(f"{folder}: another process is training in this folder") from None


def _check_same(file: Path, settings: Mapping[str, Any]) -> None:
    stored = read_description(file.parent).settings
    for name, value, expected in differences(stored, json.loads(json.dumps(settings))):
        raise TrainingError(
            f"{file}: {name}: found {value!r}, expected {expected!r}; choose another folder"
        )


def _write(file: Path, settings: Mapping[str, Any], made_with: Mapping[str, str]) -> None:
    description = {"settings": settings, "made_with": dict(made_with)}
    write_text(file, json.dumps(description, indent=2) + "\n")


def _with_earlier_starts(folder: Path, made_with: Mapping[str, str]) -> dict[str, str]:
    """Return code, machine and versions of all starts that left something; warn of other code."""
    if not (folder / CHECKPOINT_FILE).exists():
        return dict(made_with)
    before = read_description(folder).made_with
    code = str(made_with.get("code"))
    if code.endswith("-dirty") or str(before.get("code")).split("; ")[-1] != code:
        _logger.warning(
            "%s: continues with code %s, and was started with code %s; if the crops, the network "
            "or the loss differ, train again in another folder",
            folder,
            code,
            before.get("code"),
        )
    return together([before, made_with])


def read_description(folder: Path) -> Description:
    """Return the settings and the origin of a training."""
    return read_json(Description, folder / SETTINGS_FILE, TrainingError)


def read_scores(folder: Path) -> FinalScores:
    """Return the scores of a finished training."""
    return read_json(FinalScores, folder / SCORES_FILE, TrainingError)


def write_curve(folder: Path, curve: list[Row]) -> None:
    """Write the learning curve as a table."""
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, list(curve[0]), lineterminator="\n")
    table.writeheader()
    table.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in curve)
    write_text(folder / CURVE_FILE, text.getvalue())
