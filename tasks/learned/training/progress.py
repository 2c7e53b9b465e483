"""Checkpoints of a training: all that its next steps depend on."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import nn

from eres_render.storage.atomic import new_file
from tasks.errors import TrainingError
from tasks.learned.checkpoint import read_checkpoint
from tasks.learned.training.run_folder import Row

FILE_NAME = "checkpoint.pt"


@dataclass(slots=True)
class Progress:
    """How far a training is.

    Parameters
    ----------
    step
        Number of completed steps.
    seconds
        Time that they took.
    curve
        Step, seconds, loss and scores of each validation, by name.
    losses
        Losses of the steps since then.
    """

    step: int = 0
    seconds: float = 0.0
    curve: list[Row] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)


def save_checkpoint(
    folder: Path, progress: Progress, network: nn.Module, optimizer: torch.optim.Optimizer
) -> None:
    """Write all that the next steps depend on.

    Parameters
    ----------
    folder
        Folder of the training.
    progress
        How far it is.
    network, optimizer
        Their state is written.
    """
    content = {
        "step": progress.step,
        "seconds": progress.seconds,
        "curve": progress.curve,
        "losses": progress.losses,
        "network": network.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    with new_file(folder / FILE_NAME) as unfinished:
        torch.save(content, unfinished)


def load_checkpoint(folder: Path, network: nn.Module, optimizer: torch.optim.Optimizer) -> Progress:
    """Continue after the last checkpoint, if there is one.

    Parameters
    ----------
    folder
        Folder of the training.
    network, optimizer
        They take on the state that was written.

    Returns
    -------
    How far the training was.

    Raises
    ------
    WeightsError
        The checkpoint cannot be read.
    TrainingError
        It is not of this training.
    """
    file = folder / FILE_NAME
    if not file.exists():
        return Progress()
    found = read_checkpoint(file)
    try:
        network.load_state_dict(found["network"])
        optimizer.load_state_dict(found["optimizer"])
        return Progress(found["step"], found["seconds"], found["curve"], found["losses"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise TrainingError(
            f"{file}: not a checkpoint of this training ({str(error).splitlines()[0]}); delete it "
            "to start again"
        ) from None
