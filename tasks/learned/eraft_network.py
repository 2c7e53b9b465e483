"""E-RAFT's network: dense optical flow from the voxel grids of two windows.

Gehrig, Millhäusler, Gehrig and Scaramuzza, "E-RAFT: Dense Optical Flow from Event Cameras" (3DV
2021), after RAFT (Teed and Deng, ECCV 2020). Names of modules are those of the published weights.
"""

from __future__ import annotations

from collections import OrderedDict

import torch
from torch import Tensor, nn
from torch.nn import functional

from tasks.learned.correlation import CHANNELS, Correlation

CELL_PX = 8  # side of the cells on which flow is searched
MULTIPLE_PX = 32  # sides of the padded image are multiples of this
ITERATIONS = 12
_HIDDEN = 128


class ERAFT(nn.Module):
    """The network; `narrower` divides the published channels of each layer: 1, 2, 4, 8 or 16."""

    def __init__(self, bins: int, narrower: int = 1) -> None:
        super().__init__()
        self.fnet = _Encoder(bins, "instance", narrower)
        self.cnet = _Encoder(bins, "batch", narrower)
        self.update_block = _UpdateBlock(narrower)

    def forward(self, old: Tensor, new: Tensor, iterations: int = ITERATIONS) -> list[Tensor]:
        """Return how far pixels move from the end of the old window to the end of the new window.

        Grids are (N, bins, H, W), flows (N, 2, H, W) px, x first: in training after each update,
        otherwise after the last.
        """
        height, width = old.shape[-2:]
        old, new = padded(old), padded(new)
        correlation = Correlation(self.fnet(old), self.fnet(new))
        hidden, context = self.cnet(new).chunk(2, dim=1)
        hidden, context = torch.tanh(hidden), torch.relu(context)
        grid = cells(*hidden.shape[-2:]).to(old)
        flow = torch.zeros_like(grid).repeat(len(old), 1, 1, 1)
        full = []
        for k in range(iterations):
            flow = flow.detach()
            looked_up = correlation.look_up(grid + flow)
            hidden, step = self.update_block.step(hidden, context, looked_up, flow)
            flow = flow + step
            if self.training or k == iterations - 1:
                larger = enlarged(flow, self.update_block.weights(hidden))
                full.append(larger[..., -height:, -width:])
        return full


def padded(grid: Tensor) -> Tensor:
    """Pad with zeros on the left and at the top, to multiples of 32 px."""
    height, width = grid.shape[-2:]
    return functional.pad(grid, (-width % MULTIPLE_PX, 0, -height % MULTIPLE_PX, 0))


def cells(height: int, width: int) -> Tensor:
    """Return the coordinates of cells, (1, 2, height, width), x first."""
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return torch.stack([x, y])[None].float()


def enlarged(flow: Tensor, weights: Tensor) -> Tensor:
    """Return the flow of pixels as convex combinations of the flow of 3 x 3 cells.

    (N, 2, h, w) cells in, (N, 2, 8 h, 8 w) px out. Weights are (N, 9 * 64, h, w) before the softmax
    over the 9 neighbors, in row-major order.
    """
    count, _, height, width = flow.shape
    share = weights.view(count, 1, 9, CELL_PX, CELL_PX, height, width).softmax(dim=2)
    around = functional.unfold(CELL_PX * flow, 3, padding=1).view(count, 2, 9, 1, 1, height, width)
    fine = (share * around).sum(dim=2)  # (N, 2, row in cell, column in cell, h, w)
    return fine.permute(0, 1, 4, 2, 5, 3).reshape(count, 2, CELL_PX * height, CELL_PX * width)


class _Encoder(nn.Module):
    """Features of cells: a residual network to 1/8 of the resolution."""

    def __init__(self, bins: int, norm: str, narrower: int) -> None:
        super().__init__()
        first, second, third = (channels // narrower for channels in (64, 96, 128))
        self.norm1 = _normalization(norm, first)
        self.conv1 = nn.Conv2d(bins, first, 7, stride=2, padding=3)
        self.layer1 = _layer(first, first, 1, norm)
        self.layer2 = _layer(first, second, 2, norm)
        self.layer3 = _layer(second, third, 2, norm)
        self.conv2 = nn.Conv2d(third, 2 * _HIDDEN // narrower, 1)

    def forward(self, grid: Tensor) -> Tensor:
        x = functional.relu(self.norm1(self.conv1(grid)))
        return self.conv2(self.layer3(self.layer2(self.layer1(x))))


def _layer(channels: int, out: int, stride: int, norm: str) -> nn.Sequential:
    return nn.Sequential(
        _ResidualBlock(channels, out, stride, norm), _ResidualBlock(out, out, 1, norm)
    )


def _normalization(norm: str, channels: int) -> nn.Module:
    return nn.BatchNorm2d(channels) if norm == "batch" else nn.InstanceNorm2d(channels)


class _ResidualBlock(nn.Module):
    def __init__(self, channels: int, out: int, stride: int, norm: str) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels, out, 3, stride, padding=1)
        self.conv2 = nn.Conv2d(out, out, 3, padding=1)
        self.norm1 = _normalization(norm, out)
        self.norm2 = _normalization(norm, out)
        if stride != 1:
            # Published weights have this normalization under two names.
            self.norm3 = _normalization(norm, out)
            self.downsample = nn.Sequential(nn.Conv2d(channels, out, 1, stride), self.norm3)

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.norm1(self.conv1(x)))
        y = functional.relu(self.norm2(self.conv2(y)))
        return functional.relu((self.downsample(x) if hasattr(self, "downsample") else x) + y)


class _UpdateBlock(nn.Module):
    """Updates the hidden state and the flow from the looked-up correlation."""

    def __init__(self, narrower: int) -> None:
        super().__init__()
        hidden = _HIDDEN // narrower
        self.encoder = _MotionEncoder(narrower)
        self.gru = _SeparableGRU(hidden)
        self.flow_head = nn.Sequential(
            OrderedDict(
                conv1=nn.Conv2d(hidden, 2 * hidden, 3, padding=1),
                relu=nn.ReLU(),
                conv2=nn.Conv2d(2 * hidden, 2, 3, padding=1),
            )
        )
        self.mask = nn.Sequential(
            nn.Conv2d(hidden, 2 * hidden, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(2 * hidden, 9 * CELL_PX**2, 1),
        )

    def step(
        self, hidden: Tensor, context: Tensor, looked_up: Tensor, flow: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the new hidden state, and how the flow changes, in cells."""
        motion = self.encoder(looked_up, flow)
        hidden = self.gru(hidden, torch.cat([context, motion.to(context.dtype)], dim=1))
        return hidden, self.flow_head(hidden).to(flow.dtype)

    def weights(self, hidden: Tensor) -> Tensor:
        """Return the weights with which `enlarged` combines cells."""
        return 0.25 * self.mask(hidden).to(torch.float32)


class _MotionEncoder(nn.Module):
    def __init__(self, narrower: int) -> None:
        super().__init__()
        quarter, half, most, whole = (channels // narrower for channels in (64, 128, 192, 256))
        self.convc1 = nn.Conv2d(CHANNELS, whole, 1)
        self.convc2 = nn.Conv2d(whole, most, 3, padding=1)
        self.convf1 = nn.Conv2d(2, half, 7, padding=3)
        self.convf2 = nn.Conv2d(half, quarter, 3, padding=1)
        self.conv = nn.Conv2d(whole, half - 2, 3, padding=1)  # the flow adds two channels

    def forward(self, looked_up: Tensor, flow: Tensor) -> Tensor:
        correlated = functional.relu(self.convc2(functional.relu(self.convc1(looked_up))))
        moved = functional.relu(self.convf2(functional.relu(self.convf1(flow))))
        motion = functional.relu(self.conv(torch.cat([correlated, moved], dim=1)))
        return torch.cat([motion, flow.to(motion.dtype)], dim=1)


class _SeparableGRU(nn.Module):
    """A GRU along rows, then one along columns."""

    def __init__(self, hidden: int) -> None:
        super().__init__()
        for number, kernel in ((1, (1, 5)), (2, (5, 1))):
            padding = (kernel[0] // 2, kernel[1] // 2)
            for gate in "zrq":
                conv = nn.Conv2d(3 * hidden, hidden, kernel, padding=padding)
                self.add_module(f"conv{gate}{number}", conv)

    def forward(self, hidden: Tensor, x: Tensor) -> Tensor:
        for number in (1, 2):
            update, reset, candidate = (getattr(self, f"conv{gate}{number}") for gate in "zrq")
            both = torch.cat([hidden, x], dim=1)
            z, r = torch.sigmoid(update(both)), torch.sigmoid(reset(both))
            q = torch.tanh(candidate(torch.cat([r * hidden, x], dim=1)))
            hidden = (1 - z) * hidden + z * q
        return hidden
