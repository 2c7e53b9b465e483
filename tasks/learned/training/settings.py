"""Settings of a training, and those that come with eres."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TypeVar

from eres_render.errors import check_positive, suggestion
from eres_render.storage.settings_reader import read_toml
from tasks.errors import TrainingError
from tasks.random_crops.settings import MAX_SIDE_PX, Crops, FlowCrops

T = TypeVar("T", "ReconstructionTraining", "FlowTraining")


def _check_numbers(settings: object, besides: tuple[str, ...] = ()) -> None:
    for one in fields(settings):  # type: ignore[arg-type]
        found = getattr(settings, one.name)
        if isinstance(found, int | float) and one.name not in besides:
            check_positive(one.name, found, TrainingError)


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """How long and how fast to learn.

    Parameters
    ----------
    learning_rate
        Largest learning rate. It rises linearly, and falls to 0 along a cosine over all steps.
    validation_crops
        Number of held-out crops, each seen with ideal pixels and at cutoffs of 200 Hz and 50 Hz.
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
        if self.learning_rate > 1:
            raise TrainingError(
                f"learning_rate: found {self.learning_rate:g}, expected at most 1; 4e-4 is usual"
            )

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

    Parameters
    ----------
    run_in_windows
        Largest number of windows before those that are learned from; each step draws its own
        number. Their events enter the sums of events, so that the network sees sums of all ages.
    windows_at_once
        Number of windows through which gradients flow, a divisor of `windows`. The network's memory
        lasts through all windows.
    ranked_px
        Side of the area around a crop in which pixels are ranked, px. A pixel's rank is its target;
        so it depends on what the crop does not show. Held-out crops are as large.
    tiles
        Number of tiles along a side of a crop, in which images are compared once more, whatever
        their mean and contrast.
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
        _check_numbers(self, besides=("run_in_windows", "residual_blocks"))
        for name in ("bins", "base_channels"):
            if (found := getattr(self, name)) < 2:
                raise TrainingError(f"{name}: found {found}, expected at least 2")
        for name in ("run_in_windows", "residual_blocks"):
            if getattr(self, name) < 0:
                raise TrainingError(f"{name}: found {getattr(self, name)}, expected 0 or more")
        if self.windows % self.windows_at_once:
            raise TrainingError(
                f"windows_at_once: found {self.windows_at_once}, expected a divisor of "
                f"{self.windows}, the number of windows"
            )
        for name, side_px in (("crops.side_px", self.crops.side_px), ("ranked_px", self.ranked_px)):
            if side_px % 2**self.encoders:
                raise TrainingError(
                    f"{name}: found {side_px}, expected a multiple of {2**self.encoders}, for "
                    f"{self.encoders} encoders"
                )
        if self.crops.side_px % self.tiles:
            raise TrainingError(
                f"tiles: found {self.tiles}, expected a divisor of crops.side_px, "
                f"{self.crops.side_px}"
            )
        side_px = self.crops.side_px
        most_px = min(2 * side_px, MAX_SIDE_PX)  # tilted beyond 2, the plane has a horizon
        if not side_px <= self.ranked_px <= most_px:
            raise TrainingError(
                f"ranked_px: found {self.ranked_px}, expected at least crops.side_px, {side_px}, "
                f"and at most {most_px}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowTraining:
    """Training of our network for dense flow.

    Parameters
    ----------
    narrower
        Divisor of the number of channels of each of E-RAFT's layers: 1, 2, 4, 8 or 16.
    windows
        Number of windows of each crop; all but the first are learned from, each with the one before
        it.
    fading
        Weight of an update in the loss relative to the next one's.
    """

    crops: FlowCrops = field(default_factory=FlowCrops)
    schedule: FlowSchedule = field(default_factory=FlowSchedule)
    bins: int = 15
    narrower: int = 4
    windows: int = 4
    updates: int = 6
    fading: float = 0.8

    def __post_init__(self) -> None:
        _check_numbers(self)
        if self.narrower not in (1, 2, 4, 8, 16):
            raise TrainingError(f"narrower: found {self.narrower}, expected 1, 2, 4, 8 or 16")
        for name in ("bins", "windows"):
            if getattr(self, name) < 2:
                raise TrainingError(f"{name}: found {getattr(self, name)}, expected at least 2")
        if self.crops.side_px < 128:
            raise TrainingError(
                f"crops.side_px: found {self.crops.side_px}, expected at least 128, the smallest "
                "image of the network"
            )


_TRIAL: dict[str, int] = {
    "steps": 40,
    "crops_per_step": 2,
    "rising_steps": 4,
    "validation_crops": 2,
}

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
    """Return the settings of a training.

    Parameters
    ----------
    name
        One of the names, or a TOML file with some of the fields; the others have their defaults.
    """
    if name in known:
        return known[name]
    if not name.endswith(".toml"):
        raise TrainingError(
            f"config: found {name!r}, expected a name or a .toml file; {suggestion(name, known)}"
        )
    kind: type[T] = type(next(iter(known.values())))
    return read_toml(kind, Path(name), TrainingError)
