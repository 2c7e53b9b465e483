"""The training loop: crops made ahead, AdamW, validation, checkpoints and final weights."""

from __future__ import annotations

import copy
import json
import logging
import math
import time
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.optim import Optimizer

from eres_render.cores import cores
from eres_render.errors import reading
from eres_render.progress import Progress as OnProgress
from eres_render.progress import cost, silent
from eres_render.sequence.sequence import read_ahead
from eres_render.storage.atomic import write_text
from sensor.memory import memory_bytes
from tasks.errors import TrainingError
from tasks.learned.checkpoint import read_checkpoint, write_checkpoint
from tasks.learned.cpu import has_bfloat16
from tasks.learned.ours import save
from tasks.learned.training import run_folder as files
from tasks.learned.training.curve import draw_curve
from tasks.learned.training.problem import Problem
from tasks.learned.training.settings import Schedule

Scores = dict[str, list[float]]

_logger = logging.getLogger(__name__)

_BYTES_A_WEIGHT = 14  # on disk: half precision, and with two moments in the checkpoint


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
    curve: list[files.Row] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)


def save_checkpoint(
    folder: Path, progress: LearningCurve, network: nn.Module, optimizer: Optimizer
) -> None:
    """Write everything on which the next steps depend."""
    content = {"network": network.state_dict(), "optimizer": optimizer.state_dict()}
    write_checkpoint(folder / files.CHECKPOINT_FILE, {**asdict(progress), **content})


def load_checkpoint(folder: Path, network: nn.Module, optimizer: Optimizer) -> LearningCurve:
    """Load the last checkpoint, if there is one."""
    file = folder / files.CHECKPOINT_FILE
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


def train(
    problem: Problem,
    schedule: Schedule,
    folder: Path,
    *,
    device: str | None = None,
    on_progress: OnProgress = silent,
) -> Scores:
    """Train a network, or continue after the last checkpoint.

    On the processor of the same machine, with the same number of threads, an interrupted training
    ends with the same weights as an uninterrupted one.
    """
    if (folder / files.WEIGHTS_FILE).exists():
        read_checkpoint(folder / files.WEIGHTS_FILE)  # it may be damaged
        return {light: list(scores) for light, scores in files.read_scores(folder).scores.items()}
    place = device_of(device)
    problem.network.to(place).train()
    optimizer = optimizer_of(problem, schedule)
    progress = load_checkpoint(folder, problem.network, optimizer)
    on_progress("held-out crops", progress.step, schedule.steps)
    problem.hold_out()
    saved_s = started_s = time.monotonic()
    before_s = progress.seconds
    steps = range(progress.step, schedule.steps)
    with closing(read_ahead(problem.batch, steps)) as batches:
        for batch in batches:
            loss = learn(problem, schedule, optimizer, progress.step, batch, place)
            progress.losses.append(loss)
            progress.step += 1
            now_s = time.monotonic()
            progress.seconds = before_s + now_s - started_s
            is_last = progress.step == schedule.steps
            if progress.step % schedule.validate_every == 0 and not is_last:
                _validate(problem, progress, place, folder)
            if now_s - saved_s > 60 * schedule.checkpoint_minutes or is_last:
                save_checkpoint(folder, progress, problem.network, optimizer)
                saved_s = now_s
            on_progress(_in_words(progress, problem), progress.step, schedule.steps)
    _round_to_half(problem.network)
    scores = _validate(problem, progress, place, folder)
    content = {
        "score": problem.score,
        "baselines": problem.baselines,
        "scores": scores,
        "seconds": progress.seconds,
        "steps": progress.step,
        "device": place.type,
    }
    write_text(folder / files.SCORES_FILE, json.dumps(content, indent=2) + "\n")
    origin = {"seed": problem.seed, "steps": progress.step}
    save(folder / files.WEIGHTS_FILE, problem.network, problem.architecture, problem.light, origin)
    return scores


def check_machine(problem: Problem, device: str | None) -> None:
    """Check that this machine can train a network."""
    needed, available, what = problem.memory_bytes(), memory_bytes(), "machine"
    if device_of(device).type == "cuda":  # which holds the network and all it computes
        available, what = torch.cuda.get_device_properties(0).total_memory, "GPU"
    if needed > available:
        raise TrainingError(
            f"train: needs about {needed / 1e9:.1f} GB of memory, but this {what} has "
            f"{available / 1e9:.1f} GB; lower crops.side_px, schedule.crops_per_step or "
            "schedule.validation_crops"
        )


def estimate(problem: Problem, schedule: Schedule, device: str | None) -> str:
    """Describe in one line what a training takes; a copy of the network learns one step twice."""
    place, trial = device_of(device), copy.deepcopy(problem)
    trial.network.to(place).train()
    optimizer = optimizer_of(trial, schedule)
    for _ in range(2):  # the first time it compiles
        started_s = time.perf_counter()
        batch = trial.batch(0)
        made_s = time.perf_counter()
        learn(trial, schedule, optimizer, 0, batch, place)
    step_s = time.perf_counter() - made_s + (made_s - started_s) / cores()
    weights = sum(tensor.numel() for tensor in problem.network.parameters())
    takes = cost(_BYTES_A_WEIGHT * weights, schedule.steps * step_s)
    return (
        f"{schedule.steps} steps of {schedule.crops_per_step} crops, {weights} weights: about "
        f"{problem.memory_bytes() / 1e9:.1f} GB of memory, {takes}"
    )


def device_of(name: str | None) -> torch.device:
    """Return the device to train on: "cpu", "cuda", or by default a GPU if there is one."""
    has_cuda = torch.cuda.is_available()
    if name == "cuda" and not has_cuda:
        raise TrainingError("device: 'cuda' needs a GPU, but PyTorch finds none")
    return torch.device(name or ("cuda" if has_cuda else "cpu"))


def optimizer_of(problem: Problem, schedule: Schedule) -> Optimizer:
    """Return the optimizer of a training."""
    return torch.optim.AdamW(problem.network.parameters(), weight_decay=schedule.weight_decay)


def learn(
    problem: Problem,
    schedule: Schedule,
    optimizer: Optimizer,
    step: int,
    batch: list[Tensor],
    place: torch.device,
) -> float:
    """Learn from a batch."""
    for group in optimizer.param_groups:
        group["lr"] = schedule.rate(step)
    losses = problem.losses([tensor.to(place) for tensor in batch])
    values: list[float] = []
    while True:
        with _autocast(place):
            loss = next(losses, None)
        if loss is None:
            return math.fsum(values) / len(values)
        values.append(float(loss.detach()))
        if not math.isfinite(values[-1]):
            raise TrainingError(
                f"step {step}: the loss is {values[-1]}; lower schedule.learning_rate, and train "
                "in another folder"
            )
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(problem.network.parameters(), schedule.largest_gradient)
        optimizer.step()


def _autocast(place: torch.device) -> torch.autocast:
    """Compute in bfloat16 if the device supports it, as with trained networks."""
    on_gpu = place.type == "cuda"
    is_fast = torch.cuda.is_bf16_supported(False) if on_gpu else has_bfloat16()  # not emulated
    return torch.autocast(place.type, torch.bfloat16, enabled=is_fast)


def _validate(
    problem: Problem, progress: LearningCurve, place: torch.device, folder: Path
) -> Scores:
    """Score the network, and add a row to the learning curve."""
    with _autocast(place):
        scores = problem.scores(place)
    losses = progress.losses
    row = {"step": float(progress.step), "seconds": progress.seconds}
    row["loss"] = math.fsum(losses) / len(losses) if losses else math.nan
    losses.clear()
    for light, values in scores.items():
        for name, value in zip(("network", *problem.baselines), values, strict=True):
            row[f"{light}, {name}"] = value
    progress.curve.append(row)
    files.write_curve(folder, progress.curve)
    draw_curve(folder / files.PICTURE_FILE, progress.curve, problem.score)
    _logger.info(_in_words(progress, problem))
    return scores


def _in_words(progress: LearningCurve, problem: Problem) -> str:
    """Describe the progress of a training in one line."""
    words = [f"step {progress.step}"]
    if progress.curve:
        row = progress.curve[-1]
        words.append(f"loss {row['loss']:.4f}")
        for column, value in row.items():
            light, _, name = column.partition(", ")
            if name == "network":
                others = [f"{other} {row[f'{light}, {other}']:.2f}" for other in problem.baselines]
                words.append(f"{light} {value:.2f} ({', '.join(others)})")
        words[-1] += f" {problem.score.partition('[')[2].rstrip(']')}"
    return ", ".join(words)


def _round_to_half(network: nn.Module) -> None:
    """Round the weights to half precision, as they are stored."""
    with torch.no_grad():
        for tensor in network.state_dict().values():
            if tensor.is_floating_point():
                tensor.copy_(tensor.half())
