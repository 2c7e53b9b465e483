"""What a network learns and how it is scored: the part that both tasks share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tasks.learned.training.settings import FlowTraining, ReconstructionTraining
from tasks.random_crops.crop import Crop, random_crop
from tasks.random_crops.settings import CropLight, Crops

Arrays = tuple[NDArray[np.float32], ...]

LIGHTS = {"ideal": math.inf, "200 Hz": 200.0, "50 Hz": 50.0}
"""Cutoffs of the validation crops, Hz, by name."""

_HELD_OUT_SEED = 0
_BYTES_PER_SCORED_PX = 750  # at most that much was measured, by reconstruction in float32


class Problem(ABC):
    """A network, the crops from which it learns, and those on which it is scored."""

    architecture: ClassVar[str]
    score: ClassVar[str]
    """Name of the score, with its unit."""
    baselines: ClassVar[tuple[str, ...]]
    """Names of the baselines with which the network is compared."""

    def __init__(
        self, settings: ReconstructionTraining | FlowTraining, light: CropLight, seed: int
    ) -> None:
        self.settings, self.light, self.seed = settings, light, seed
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network = self.new_network()
        # Samples of each light, and their scores with the baselines.
        self._held_out: dict[str, tuple[list[Tensor], list[float]]] = {}

    @abstractmethod
    def new_network(self) -> nn.Module:
        """Return the network before the first step."""

    @abstractmethod
    def sample(self, crop: Crop, run_in: int) -> Arrays:
        """Return the arrays that are learned from a crop."""

    @abstractmethod
    def losses(self, batch: Sequence[Tensor]) -> Iterator[Tensor]:
        """Yield the losses of a batch of samples; the network learns from each before the next."""

    @abstractmethod
    def network_score(self, batch: Sequence[Tensor]) -> float:
        """Return the mean score of the network on a batch of samples."""

    @abstractmethod
    def baseline_scores(self, crop: Crop, sample: Arrays) -> list[float]:
        """Return the score of each baseline on a crop."""

    @abstractmethod
    def step_bytes(self) -> int:
        """Return an estimate of the memory that a step needs, bytes."""

    @property
    @abstractmethod
    def values_per_px(self) -> int:
        """Return how many values per pixel a sample has."""

    def memory_bytes(self) -> int:
        """Return an estimate of the memory that a training needs, bytes.

        It is that of a step, of the held-out crops of all lights, and of scoring those of a light.
        """
        crops, _ = self.held_out()
        held_out_px = self.settings.schedule.validation_crops * crops.side_px**2
        held_out = 4 * self.values_per_px * len(LIGHTS) + _BYTES_PER_SCORED_PX
        return self.step_bytes() + held_out * held_out_px

    def run_in(self, step: int) -> int:
        """Return the number of windows before those from which a step learns."""
        return 0

    def held_out(self) -> tuple[Crops, int]:
        """Return what held-out crops look like, and the number of windows before theirs."""
        return self.settings.crops, 0

    def batch(self, step: int) -> list[Tensor]:
        """Return the samples of a step; they depend only on settings, light, seed and step."""
        crops, run_in = self.settings.crops, self.run_in(step)
        count, windows = self.settings.schedule.crops_per_step, run_in + self.settings.windows
        indices = range(step * count, (step + 1) * count)
        drawn = (random_crop(crops, windows, self.seed, k, light=self.light) for k in indices)
        return _joined([self.sample(crop, run_in) for crop in drawn])

    def hold_out(self) -> None:
        """Make the held-out crops, which are the same for every seed, and score the baselines."""
        crops, run_in = self.held_out()
        windows = run_in + self.settings.windows
        for name, cutoff_hz in LIGHTS.items():
            samples, scores = [], []
            for index in range(self.settings.schedule.validation_crops):
                crop = random_crop(
                    crops, windows, _HELD_OUT_SEED, index, light=cutoff_hz, held_out=True
                )
                samples.append(self.sample(crop, run_in))
                scores.append(self.baseline_scores(crop, samples[-1]))
            self._held_out[name] = _joined(samples), np.mean(scores, axis=0).tolist()

    def scores(self, device: str) -> dict[str, tuple[float, ...]]:
        """Return mean scores on the held-out crops.

        Parameters
        ----------
        device
            The network's device.
        """
        self.network.eval()
        with torch.inference_mode():
            scores = {
                name: (self.network_score([tensor.to(device) for tensor in batch]), *baselines)
                for name, (batch, baselines) in self._held_out.items()
            }
        self.network.train()
        return scores


def _joined(samples: Sequence[Arrays]) -> list[Tensor]:
    return [torch.from_numpy(np.stack(arrays)) for arrays in zip(*samples, strict=True)]
