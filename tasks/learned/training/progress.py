"""Checkpoints of a training: everything on which its next steps depend."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import nn

from eres_render.errors import reading
from tasks.errors import TrainingError
from tasks.learned.checkpoint import read_checkpoint, write_checkpoint
from tasks.learned.training.run_folder import CHECKPOINT_FILE, Row


@dataclass(slots=True)
class LearningCurve:
    """How far a training is.

    Parameters
    ----------
    seconds
        Time that these took, s.
    curve
        Step, seconds, loss and scores of each validation, by name.
    """

    step: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)


def save_checkpoint(
    folder: Path, progress: LearningCurve, network: nn.Module, optimizer: torch.optim.Optimizer
) -> None:
    """Write everything on which the next steps depend."""
    content = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
    write_checkpoint(folder / CHECKPOINT_FILE, {**asdict(progress), **content})


def load_checkpoint(
    folder: Path, network: nn.Module, optimizer: torch.optim.Optimizer
) -> LearningCurve:
    """Load the last checkpoint, if there is one."""
    file = folder / CHECKPOINT_FILE
    if not file.exists():
        return LearningCurve()
    content = read_checkpoint(file)
    kind = "the checkpoint of this training (delete it to start again)"
    with reading(file, kind, TrainingError):
        network.load_state_dict(content["network"])
        optimizer.load_state_dict(content["optimizer"])
        return LearningCurve(
            content["step"], content["seconds"], content["curve"], content["losses"]
        )
