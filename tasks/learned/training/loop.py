"""The training loop: crops made ahead, AdamW, validation, checkpoints, curve and final weights."""

from __future__ import annotations

import copy
import csv
import dataclasses
import io
import json
import logging
import math
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

from eres_render.cores import cores
from eres_render.errors import reading
from eres_render.progress import Progress as OnProgress
from eres_render.progress import cost, silent
from eres_render.sequence.sequence import read_ahead
from eres_render.storage.atomic import write_bytes, write_text
from sensor.cameras.files import values_of
from sensor.memory import memory_bytes
from tasks.errors import TrainingError
from tasks.learned.checkpoint import read_checkpoint, write_checkpoint
from tasks.learned.cpu import has_bfloat16
from tasks.learned.ours import save
from tasks.learned.training import run_folder as files
from tasks.learned.training.flow import Flow
from tasks.learned.training.problem import LIGHTS, Problem
from tasks.learned.training.reconstruction import Reconstruction
from tasks.learned.training.settings import FlowTraining, ReconstructionTraining
from tasks.random_crops.settings import CropLight

Scores = dict[str, tuple[float, ...]]

_logger = logging.getLogger(__name__)

_BYTES_A_WEIGHT = 14  # on disk: half precision, and with two moments in the checkpoint


class Training:
    """A network on its device, by default a GPU if there is one, with its optimizer and step.

    On the processor of the same machine, with the same number of threads, an interrupted training
    ends with the same weights as an uninterrupted training.
    """

    def __init__(self, problem: Problem, device: str | None) -> None:
        has_cuda = torch.cuda.is_available()
        if device == "cuda" and not has_cuda:
            raise TrainingError("device: 'cuda' needs a GPU, but PyTorch finds none")
        self.device = device or ("cuda" if has_cuda else "cpu")
        self._problem, self._network = problem, problem.network
        self._schedule = problem.settings.schedule
        self._check_memory()
        self._network.to(self.device).train()
        self._optimizer = torch.optim.AdamW(
            self._network.parameters(), weight_decay=self._schedule.weight_decay
        )
        self.step = 0
        self._seconds = 0.0  # that the steps took
        # Step, seconds, loss and scores of each validation, by name; losses since the last one.
        self._curve: list[dict[str, float]] = []
        self._losses: list[float] = []

    def _check_memory(self) -> None:
        needed, available, what = self._problem.memory_bytes(), memory_bytes(), "machine"
        if self.device == "cuda":  # which holds the network and all it computes
            available, what = torch.cuda.get_device_properties(0).total_memory, "GPU"
        if needed > available:
            raise TrainingError(
                f"train: needs about {needed / 1e9:.1f} GB of memory, but this {what} has "
                f"{available / 1e9:.1f} GB; lower crops.side_px, schedule.crops_per_step or "
                "schedule.validation_crops"
            )

    def save(self, folder: Path) -> None:
        """Write everything on which the next steps depend."""
        content = {
            "step": self.step,
            "seconds": self._seconds,
            "curve": self._curve,
            "losses": self._losses,
            "network": self._network.state_dict(),
            "optimizer": self._optimizer.state_dict(),
        }
        write_checkpoint(folder / files.CHECKPOINT_FILE, content)

    def load(self, folder: Path) -> None:
        """Load the last checkpoint, if there is one."""
        file = folder / files.CHECKPOINT_FILE
        if not file.exists():
            return
        content = read_checkpoint(file)
        kind = "the checkpoint of this training (delete it to start again)"
        with reading(file, kind, TrainingError):
            self._network.load_state_dict(content["network"])
            self._optimizer.load_state_dict(content["optimizer"])
            self.step, self._seconds = content["step"], content["seconds"]
            self._curve, self._losses = content["curve"], content["losses"]

    def estimate(self) -> str:
        """Describe in one line what it takes; a copy of the network learns one step twice."""
        trial, schedule = Training(copy.deepcopy(self._problem), self.device), self._schedule
        for _ in range(2):  # the first time it compiles
            started_s = time.perf_counter()
            batch = self._problem.batch(0)
            made_s = time.perf_counter()
            trial.learn(batch)
        step_s = time.perf_counter() - made_s + (made_s - started_s) / cores()
        weights = sum(tensor.numel() for tensor in self._network.parameters())
        takes = cost(_BYTES_A_WEIGHT * weights, schedule.steps * step_s)
        return (
            f"{schedule.steps} steps of {schedule.crops_per_step} crops, {weights} weights: about "
            f"{self._problem.memory_bytes() / 1e9:.1f} GB of memory, {takes}"
        )

    def run(self, folder: Path, on_progress: OnProgress) -> Scores:
        """Train the network, or continue after the last checkpoint."""
        problem, schedule = self._problem, self._schedule
        self.load(folder)
        on_progress("held-out crops", self.step, schedule.steps)
        problem.hold_out()
        saved_s = started_s = time.monotonic()
        before_s = self._seconds
        with closing(read_ahead(problem.batch, range(self.step, schedule.steps))) as batches:
            for batch in batches:
                self._losses.append(self.learn(batch))
                self.step += 1
                now_s = time.monotonic()
                self._seconds = before_s + now_s - started_s
                is_last = self.step == schedule.steps
                if self.step % schedule.validate_every == 0 and not is_last:
                    self._validate(folder)
                if now_s - saved_s > 60 * schedule.checkpoint_minutes or is_last:
                    self.save(folder)
                    saved_s = now_s
                on_progress(self._in_words(), self.step, schedule.steps)
        self._network.half().float()  # as the weights are stored
        scores = self._validate(folder)
        described = problem.score, problem.baselines, scores
        final = files.FinalScores(*described, self._seconds, self.step, self.device)
        content = json.dumps(dataclasses.asdict(final), indent=2)
        write_text(folder / files.SCORES_FILE, content + "\n")
        origin = {"seed": problem.seed, "steps": self.step}
        weights = folder / files.WEIGHTS_FILE
        save(weights, self._network, problem.architecture, problem.light, origin)
        return scores

    def learn(self, batch: Sequence[Tensor]) -> float:
        """Learn from a batch, and return its mean loss."""
        for group in self._optimizer.param_groups:
            group["lr"] = self._schedule.rate(self.step)
        losses = self._problem.losses([tensor.to(self.device) for tensor in batch])
        values: list[float] = []
        while True:
            with self._autocast():
                loss = next(losses, None)
            if loss is None:
                return math.fsum(values) / len(values)
            values.append(float(loss.detach()))
            if not math.isfinite(values[-1]):
                raise TrainingError(
                    f"step {self.step}: the loss is {values[-1]}; lower schedule.learning_rate, "
                    "and train in another folder"
                )
            self._optimizer.zero_grad(set_to_none=True)
            loss.backward()
            torch.nn.utils.clip_grad_norm_(
                self._network.parameters(), self._schedule.largest_gradient
            )
            self._optimizer.step()

    def _autocast(self) -> torch.autocast:
        """Compute in bfloat16 if the device supports it, as with trained networks."""
        on_gpu = self.device == "cuda"
        is_fast = torch.cuda.is_bf16_supported(False) if on_gpu else has_bfloat16()  # not emulated
        return torch.autocast(self.device, torch.bfloat16, enabled=is_fast)

    def _validate(self, folder: Path) -> Scores:
        """Score the network, and add a row to the learning curve."""
        problem, losses = self._problem, self._losses
        with self._autocast():
            scores = problem.scores(self.device)
        row = {"step": float(self.step), "seconds": self._seconds}
        row["loss"] = math.fsum(losses) / len(losses) if losses else math.nan
        losses.clear()
        for light, values in scores.items():
            for name, value in zip(("network", *problem.baselines), values, strict=True):
                row[f"{light}, {name}"] = value
        self._curve.append(row)
        self._write_curve(folder)
        _logger.info(self._in_words())
        return scores

    def _write_curve(self, folder: Path) -> None:
        """Write the learning curve as a table, and as a picture with a panel for each light."""
        curve, problem, text = self._curve, self._problem, io.StringIO(newline="")
        table = csv.DictWriter(text, list(curve[0]), lineterminator="\n")
        table.writeheader()
        table.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in curve)
        write_text(folder / "curve.csv", text.getvalue())
        steps = [row["step"] for row in curve]
        figure = Figure(figsize=(3.2 * len(LIGHTS), 2.8), layout="constrained")
        panels = figure.subplots(1, len(LIGHTS), sharey=True)
        for panel, light in zip(panels, LIGHTS, strict=True):
            panel.set_title(light)
            panel.set_xlabel("step")
            scores = [row[f"{light}, network"] for row in curve]
            panel.plot(steps, scores, color="C0", label="network")
            for name, style in zip(problem.baselines, ("--", ":"), strict=False):
                last = curve[-1][f"{light}, {name}"]
                panel.axhline(last, color="0.4", linestyle=style, label=name)
        panels[0].set_ylabel(problem.score)
        panels[-1].legend(fontsize="small")
        picture = io.BytesIO()
        figure.savefig(picture, format="png", dpi=120)
        write_bytes(folder / "curve.png", picture.getvalue())

    def _in_words(self) -> str:
        """Describe the progress in one line."""
        problem, words = self._problem, [f"step {self.step}"]
        if self._curve:
            row = self._curve[-1]
            words.append(f"loss {row['loss']:.4f}")
            for light in LIGHTS:
                others = (f"{name} {row[f'{light}, {name}']:.2f}" for name in problem.baselines)
                words.append(f"{light} {row[f'{light}, network']:.2f} ({', '.join(others)})")
            words[-1] += f" {problem.score.partition('[')[2].rstrip(']')}"
        return ", ".join(words)


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

    `light` is "ideal" for ideal pixels in all crops, "all" to draw the cutoff of each. It changes
    neither textures, motions and thresholds of the crops nor the initial weights, all drawn from
    `seed`. The scores are on the held-out crops, by light; a dry run only logs, without scores.
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
    weights = folder / files.WEIGHTS_FILE
    if weights.exists() and not dry_run:
        with files.opened(folder, described, made_with):
            read_checkpoint(weights)  # it may be damaged
            return problem, files.read_scores(folder).scores
    training = Training(problem, device)  # before the folder keeps settings that cannot be trained
    if dry_run:
        _logger.info("%s", training.estimate())
        return problem, {}
    with files.opened(folder, described, {**made_with, "device": training.device}):
        _logger.info("%s", training.estimate())
        return problem, training.run(folder, on_progress)
