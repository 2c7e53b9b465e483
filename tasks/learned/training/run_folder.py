"""The folder of a training: its settings, its origin and its scores."""

from __future__ import annotations

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

SETTINGS_FILE, SCORES_FILE = "training.json", "scores.json"
CHECKPOINT_FILE, WEIGHTS_FILE = "checkpoint.pt", "weights.pt"

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class FinalScores:
    """The content of scores.json: by light, mean scores of the network, then of each baseline."""

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

    `made_with` has code, machine and versions of this start. Earlier starts that left a checkpoint
    are kept next to it.
    """
    file = folder / SETTINGS_FILE
    try:
        with locked(folder / ".lock", wait=False):
            clear_unfinished(folder)
            written = [name for name in (WEIGHTS_FILE, CHECKPOINT_FILE) if (folder / name).exists()]
            is_finished = WEIGHTS_FILE in written
            if file.exists():
                stored = read_description(folder)
                given = json.loads(json.dumps(settings))
                for name, value, expected in differences(stored.settings, given):
                    raise TrainingError(
                        f"{file}: {name}: found {value!r}, expected {expected!r}; choose another "
                        "folder"
                    )
                if written == [CHECKPOINT_FILE]:
                    made_with = _continued(folder, stored.made_with, made_with)
            elif written:
                raise TrainingError(
                    f"{file}: is missing, so the settings of {written[0]} are unknown; choose "
                    "another folder"
                )
            if not is_finished:
                description = {"settings": settings, "made_with": dict(made_with)}
                write_text(file, json.dumps(description, indent=2) + "\n")
            yield
    except LockedError:
        raise TrainingError(f"{folder}: another process is training in this folder") from None


def _continued(
    folder: Path, before: Mapping[str, str], made_with: Mapping[str, str]
) -> dict[str, str]:
    """Return code, machine and versions of all starts that left something; warn of other code."""
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
