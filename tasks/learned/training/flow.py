"""Training of our network for dense optical flow, a smaller E-RAFT."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from sensor.representations import voxel_grid
from tasks.learned.eraft_network import ERAFT
from tasks.learned.ours import FLOW
from tasks.learned.training.problem import Arrays, Problem
from tasks.learned.training.settings import FlowTraining
from tasks.random_crops.crop import Crop

# Memory per pixel, pair of windows and channel of the first layer: in all, and for each update.
_BYTES_PER_PX_AND_CHANNEL = 180  # 95 were measured
_BYTES_PER_UPDATE = 20  # 14 were measured


class Flow(Problem):
    """The flow of each pixel over a window, from its events and those of the window before.

    The loss is a weighted sum over the updates of the flow of the mean absolute error of both
    components. Later updates weigh more, as in RAFT (Teed and Deng, ECCV 2020).
    """

    architecture = FLOW
    score = "end-point error [px]"
    baselines = ("zero flow",)

    settings: FlowTraining

    def new_network(self) -> ERAFT:
        """As `Problem.new_network`."""
        return ERAFT(self.settings.bins, self.settings.narrower)

    def sample(self, crop: Crop, run_in: int) -> Arrays:
        """As `Problem.sample`: (pairs + 1, bins, S, S) grids, each paired with the next, and flows.

        Flows are (pairs, 2, S, S) px, from the start of a pair's second window to its end.
        """
        grids = [
            voxel_grid(events, self.settings.bins, convention="eraft") for events in crop.events
        ]
        flows = [crop.motion.flow(k, k + 1) for k in range(1, len(grids))]
        return np.stack(grids), np.stack(flows)

    def losses(self, batch: Sequence[Tensor]) -> Iterator[Tensor]:
        """As `Problem.losses`: a single loss."""
        grids, flows = batch
        old, new, truth = (x.flatten(0, 1) for x in (grids[:, :-1], grids[:, 1:], flows))
        updates = self.network(old, new, self.settings.updates)
        errors = [
            self.settings.fading**k * torch.mean(torch.abs(flow - truth))
            for k, flow in zip(reversed(range(len(updates))), updates, strict=True)
        ]
        yield torch.stack(errors).sum()

    def network_score(self, batch: Sequence[Tensor]) -> float:
        """As `Problem.network_score`: the end-point error at the last window."""
        grids, flows = batch
        (flow,) = self.network(grids[:, -2], grids[:, -1])
        return float(torch.linalg.vector_norm(flow - flows[:, -1], dim=1).mean())

    def baseline_scores(self, crop: Crop, sample: Arrays) -> list[float]:
        """As `Problem.baseline_scores`."""
        _, flows = sample
        return [float(np.linalg.norm(flows[-1], axis=0).mean())]

    def step_bytes(self) -> int:
        """As `Problem.step_bytes`."""
        settings = self.settings
        pairs = settings.schedule.crops_per_step * (settings.windows - 1)
        channels = self.network.fnet.conv1.out_channels
        per_channel = _BYTES_PER_PX_AND_CHANNEL + _BYTES_PER_UPDATE * settings.updates
        return per_channel * channels * pairs * settings.crops.side_px**2

    @property
    def values_per_px(self) -> int:
        """As `Problem.values_per_px`."""
        settings = self.settings
        return settings.windows * settings.bins + (settings.windows - 1) * 2
