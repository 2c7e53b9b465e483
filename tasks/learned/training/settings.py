"""Settings of a training, and those that come with eres."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from operator import attrgetter
from pathlib import Path
from typing import TypeVar

from eres_render.errors import check_positive, suggestion
from eres_render.storage.settings_reader import read_toml
from tasks.errors import TrainingError
from tasks.random_crops.settings import MAX_SIDE_PX, Crops, FlowCrops

T = TypeVar("T", "ReconstructionTraining", "FlowTraining")


def _check_numbers(settings: object, **least: int) -> None:
    """Check the numbers of settings: they are positive, or have another least value."""
    for entry in fields(settings):  # type: ignore[arg-type]
        name, value = entry.name, getattr(settings, entry.name)
        if name in least:
            _check(settings, name, value >= least[name], f"at least {least[name]}")
        elif isinstance(value, int | float):
            check_positive(name, value, TrainingError)


def _check(settings: object, name: str, holds: bool, expected: str) -> None:
    if not holds:
        raise TrainingError(f"{name}: found {attrgetter(name)(settings):g}, expected {expected}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How long and how fast to learn.

    The learning rate rises linearly to `learning_rate`, and falls to 0 along a cosine over all
    steps. Each held-out crop is seen with ideal pixels and at cutoffs of 200 Hz and 50 Hz.
    """

    steps: int = 4800
    crops_per_step: int = 4
    learning_rate: float = 4e-4
    rising_steps: int = 100
    weight_decay: float = 1e-4
    largest_gradient: float = 1.0
    validate_every: int = 200
    validation_crops: int = 6
    checkpoint_minutes: float = 5.0

    def __post_init__(self) -> None:
        _check_numbers(self)
        _check(self, "learning_rate", self.learning_rate <= 1, "at most 1; 4e-4 is usual")

    def rate(self, step: int) -> float:
        """Return the learning rate of a step."""
        rising = min((step + 1) / self.rising_steps, 1.0)
        return self.learning_rate * rising * 0.5 * (1 + math.cos(math.pi * step / self.steps))


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowSchedule(Schedule):
    """As `Schedule`, with other defaults."""

    steps: int = 6000


@dataclass(frozen=True, slots=True, kw_only=True)
class ReconstructionTraining:
    """Training of our network for reconstruction.

    Each step draws how many windows come before the learned windows, at most `run_in_windows`.
    Their events enter the sums of events, so that the network sees sums of all ages. Gradients flow
    through `windows_at_once` windows, a divisor of `windows`; the network's memory lasts through
    all. A pixel's target is its rank in an area of `ranked_px` around the crop, so it depends on
    what the crop does not show. Held-out crops are as large as this area. Images are also compared
    in `tiles` x `tiles` tiles, whatever their mean and contrast.
    """

    crops: Crops = field(default_factory=Crops)
    schedule: Schedule = field(default_factory=Schedule)
    bins: int = 5
    base_channels: int = 16
    encoders: int = 3
    residual_blocks: int = 2
    run_in_windows: int = 32
    windows: int = 12
    windows_at_once: int = 6
    ranked_px: int = 160
    tiles: int = 2

    def __post_init__(self) -> None:
        _check_numbers(self, bins=2, base_channels=2, run_in_windows=0, residual_blocks=0)
        side_px, ranked_px, windows = self.crops.side_px, self.ranked_px, self.windows
        multiple = 2**self.encoders
        halved = f"a multiple of {multiple}, for {self.encoders} encoders"
        most_px = min(2 * side_px, MAX_SIDE_PX)  # tilted beyond 2, the plane has a horizon
        at_once = f"a divisor of {windows}, the number of windows"
        area = f"at least crops.side_px, {side_px}, and at most {most_px}"
        _check(self, "windows_at_once", windows % self.windows_at_once == 0, at_once)
        _check(self, "crops.side_px", side_px % multiple == 0, halved)
        _check(self, "ranked_px", ranked_px % multiple == 0, halved)
        _check(self, "tiles", side_px % self.tiles == 0, f"a divisor of crops.side_px, {side_px}")
        _check(self, "ranked_px", side_px <= ranked_px <= most_px, area)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowTraining:
    """Training of our network for dense flow.

    `narrower` divides the number of channels of each of E-RAFT's layers: 1, 2, 4, 8 or 16. All
    windows of a crop but the first are learned from, each with the window before it. An update
    weighs `fading` times as much in the loss as the next update.
    """

    crops: FlowCrops = field(default_factory=FlowCrops)
    schedule: FlowSchedule = field(default_factory=FlowSchedule)
    bins: int = 15
    narrower: int = 4
    windows: int = 4
    updates: int = 6
    fading: float = 0.8

    def __post_init__(self) -> None:
        _check_numbers(self, bins=2, windows=2)
        _check(self, "narrower", self.narrower in (1, 2, 4, 8, 16), "1, 2, 4, 8 or 16")
        smallest = "at least 128, the smallest image of the network"
        _check(self, "crops.side_px", self.crops.side_px >= 128, smallest)


_TRIAL = {"steps": 40, "crops_per_step": 2, "rising_steps": 4, "validation_crops": 2}

RECONSTRUCTIONS = {
    "small": ReconstructionTraining(),
    "trial": ReconstructionTraining(
        crops=Crops(side_px=64),
        ranked_px=128,
        schedule=Schedule(**_TRIAL, validate_every=10),
        base_channels=8,
        run_in_windows=4,
        windows=8,
        windows_at_once=8,
    ),
}
"""Settings that come with eres, by name: small networks, and a short trial of smaller ones."""

FLOWS = {
    "small": FlowTraining(),
    "trial": FlowTraining(schedule=FlowSchedule(**_TRIAL, validate_every=10), narrower=8),
}
"""As `RECONSTRUCTIONS`."""


def find_training(known: dict[str, T], name: str) -> T:
    """Return known settings by name, or from a TOML file, with defaults for its missing fields."""
    if name in known:
        return known[name]
    if not name.endswith(".toml"):
        raise TrainingError(
            f"config: found {name!r}, expected a name or a .toml file; {suggestion(name, known)}"
        )
    kind: type[T] = type(next(iter(known.values())))
    return read_toml(kind, Path(name), TrainingError)
