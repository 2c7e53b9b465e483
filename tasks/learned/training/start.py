"""Start a training by the name of its task."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Mapping
from pathlib import Path

from eres_render.progress import Progress as OnProgress
from eres_render.progress import silent
from sensor.cameras.files import values_of
from tasks.learned.training.flow import Flow
from tasks.learned.training.loop import Scores, check_machine, device_of, estimate, train
from tasks.learned.training.problem import Problem
from tasks.learned.training.reconstruction import Reconstruction
from tasks.learned.training.run_folder import WEIGHTS_FILE, opened
from tasks.learned.training.settings import FlowTraining, ReconstructionTraining
from tasks.random_crops.settings import CropLight

_logger = logging.getLogger(__name__)


def start(
    settings: ReconstructionTraining | FlowTraining,
    light: CropLight,
    seed: int,
    folder: Path,
    *,
    device: str | None = None,
    made_with: Mapping[str, str],
    dry_run: bool = False,
    on_progress: OnProgress = silent,
) -> tuple[Problem, Scores]:
    """Start or continue a training; the log first gives its time, memory and disk space.

    Parameters
    ----------
    light
        "ideal" for ideal pixels in all crops, "all" to draw the cutoff of each.
    seed
        Seed of the crops and of the initial weights. The light changes neither the textures,
        motions and thresholds of the crops nor the initial weights.
    dry_run
        Whether only to log what it would take; there are no scores then.

    Returns
    -------
    The problem with its network, and scores on the held-out crops, by light.
    """
    problem: Problem
    if isinstance(settings, FlowTraining):
        task, problem = "flow", Flow(settings, light, seed)
    else:
        task, problem = "reconstruction", Reconstruction(settings, light, seed)
    described = {"task": task, "light": light, "seed": seed, **dataclasses.asdict(settings)}
    del described["crops"]["sensor"]  # of which a file could change
    if settings.crops.sensor:
        described["crops"]["sensor"] = values_of(settings.crops.camera)
    if not (folder / WEIGHTS_FILE).exists():  # a finished training is only read
        check_machine(problem, device)  # before the folder keeps settings that cannot be trained
        _logger.info("%s", estimate(problem, settings.schedule, device))
        made_with = {**made_with, "device": device_of(device).type}
    if dry_run:
        return problem, {}
    with opened(folder, described, made_with):
        scores = train(problem, settings.schedule, folder, device=device, on_progress=on_progress)
    return problem, scores
