"""Recurrent networks from voxel grids of events to images: E2VID, a U-Net, and FireNet.

Rebecq, Ranftl, Koltun and Scaramuzza, "High Speed and High Dynamic Range Video with an Event
Camera" (PAMI 2019); Scheerlinck, Rebecq, Gehrig, Barnes, Mahony and Scaramuzza, "Fast Image
Reconstruction with an Event Camera" (WACV 2020). Names of modules are those of published weights.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

State = tuple[Tensor, ...]
"""Memory of one encoder: hidden and cell state of an LSTM, or the hidden state of a GRU."""

_BAND = 1 << 20  # values of the gates that become a memory at a time


@dataclass(frozen=True, slots=True, kw_only=True)
class E2vidOptions:
    """Shape of the network, with the names and defaults of its checkpoints.

    Each encoder halves the image and doubles the channels, from `base_num_channels` at full
    resolution. Skips are "sum" or "concat", recurrent blocks "convlstm" or "convgru", and `norm` is
    "BN" (batch), "IN" (instance) or None. With `use_upsample_conv`, decoders enlarge bilinearly and
    convolve, instead of a transposed convolution.
    """

    num_bins: int
    skip_type: str = "sum"
    recurrent_block_type: str = "convlstm"
    num_encoders: int = 4
    base_num_channels: int = 32
    num_residual_blocks: int = 2
    norm: str | None = None
    use_upsample_conv: bool = True


class E2VIDRecurrent(nn.Module):
    """The network, with its weights under the prefix `unetrecurrent.`."""

    def __init__(self, options: E2vidOptions) -> None:
        super().__init__()
        self.options = options
        self.unetrecurrent = _UNetRecurrent(options)

    def forward(
        self, grid: Tensor, states: Sequence[State] | None = None
    ) -> tuple[Tensor, list[State]]:
        """Return (N, 1, H, W) images of a window, in (0, 1), and the state of each encoder.

        Grids are (N, bins, H, W); H and W are multiples of 2 to the number of encoders.
        """
        return self.unetrecurrent(grid, states or [()] * self.options.num_encoders)


class FireNet(nn.Module):
    """FireNet: 5 bins, and 16 channels at full resolution; modules have FireNet+'s names."""

    bins, channels, memories = 5, 16, 2
    _reach = 9  # rows above and below that an image depends on: 9 convolutions of 3 rows in a row

    def __init__(self) -> None:
        super().__init__()
        self.head = _Conv(self.bins, self.channels, 3, norm=None)
        self.G1, self.R1 = _ConvGRU(self.channels), _ResidualBlock(self.channels, None)
        self.G2, self.R2 = _ConvGRU(self.channels), _ResidualBlock(self.channels, None)
        self.pred = _Conv(self.channels, 1, 1, norm=None)

    def forward(
        self, grid: Tensor, states: Sequence[State] | None = None
    ) -> tuple[Tensor, list[State]]:
        """Return (N, 1, H, W) images, about 0 to 1, of (N, 5, H, W) grids, and the two states."""
        # By bands of rows: memory of the size of all channels of an image would be new each time,
        # which costs more than the arithmetic.
        height, width = grid.shape[2:]
        band = max(1, 2 * _BAND // (self.channels * width))
        parts = []
        for top in range(0, height, band):
            start = max(0, top - self._reach)
            rows = slice(start, top + band + self._reach)
            old = [(hidden[:, :, rows],) for (hidden,) in states or ()]
            inner = slice(top - start, top - start + band)
            parts.append([x[:, :, inner] for x in self._image_and_hidden(grid[:, :, rows], old)])
        image, *hidden = (torch.cat(x, dim=2) for x in zip(*parts, strict=True))
        return image, [(x,) for x in hidden]

    def _image_and_hidden(self, grid: Tensor, states: Sequence[State]) -> tuple[Tensor, ...]:
        first, second = states or [()] * self.memories
        first = self.G1(functional.relu_(self.head(grid)), first)
        second = self.G2(self.R1(*first), second)
        return self.pred(self.R2(*second)), *first, *second


class _UNetRecurrent(nn.Module):
    def __init__(self, options: E2vidOptions) -> None:
        super().__init__()
        base, norm = options.base_num_channels, options.norm
        self._joins_by_sum = options.skip_type == "sum"
        joined = 1 if self._joins_by_sum else 2
        widths = [base * 2**i for i in range(options.num_encoders + 1)]
        decoder = _UpsampleConv if options.use_upsample_conv else _TransposedConv
        self.head = _Conv(options.num_bins, base, 5, norm=None)
        self.encoders = nn.ModuleList(
            _Encoder(fine, coarse, options.recurrent_block_type, norm)
            for fine, coarse in pairwise(widths)
        )
        self.resblocks = nn.ModuleList(
            _ResidualBlock(widths[-1], norm) for _ in range(options.num_residual_blocks)
        )
        self.decoders = nn.ModuleList(
            decoder(joined * width, width // 2, norm) for width in widths[:0:-1]
        )
        self.pred = _Conv(joined * base, 1, 1, norm=norm)

    def forward(self, grid: Tensor, states: Sequence[State]) -> tuple[Tensor, list[State]]:
        x = head = functional.relu_(self.head(grid))
        new: list[State] = []
        for encoder, state in zip(self.encoders, states, strict=True):
            new.append(encoder(x, state))
            x = new[-1][0]
        for block in self.resblocks:
            x = block(x)
        for decoder, (hidden, *_) in zip(self.decoders, reversed(new), strict=True):
            x = functional.relu_(decoder(self._join(x, hidden)))
        return torch.sigmoid(self.pred(self._join(x, head))), new

    def _join(self, x: Tensor, skip: Tensor) -> Tensor:
        return x + skip if self._joins_by_sum else torch.cat([x, skip], dim=1)


class _Conv(nn.Module):
    """A convolution with an odd kernel size, and a normalization if there is one."""

    def __init__(
        self, channels: int, out: int, side: int, *, norm: str | None, stride: int = 1
    ) -> None:
        super().__init__()
        self.conv2d = nn.Conv2d(channels, out, side, stride, side // 2, bias=norm != "BN")
        self.norm_layer = _normalization(norm, out, with_statistics=True)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm_layer(self.conv2d(x))


class _UpsampleConv(_Conv):
    """Enlarges by 2 bilinearly, then convolves."""

    def __init__(self, channels: int, out: int, norm: str | None) -> None:
        super().__init__(channels, out, 5, norm=norm)

    def forward(self, x: Tensor) -> Tensor:
        larger = functional.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
        return super().forward(larger)


class _TransposedConv(nn.Module):
    """Enlarges by 2 with a transposed convolution."""

    def __init__(self, channels: int, out: int, norm: str | None) -> None:
        super().__init__()
        self.transposed_conv2d = nn.ConvTranspose2d(
            channels, out, 5, stride=2, padding=2, output_padding=1, bias=norm != "BN"
        )
        self.norm_layer = _normalization(norm, out, with_statistics=True)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm_layer(self.transposed_conv2d(x))


def _normalization(norm: str | None, channels: int, *, with_statistics: bool) -> nn.Module:
    if norm == "BN":
        return nn.BatchNorm2d(channels)
    if norm == "IN":
        return nn.InstanceNorm2d(channels, track_running_stats=with_statistics)
    return nn.Identity()


class _Encoder(nn.Module):
    """Halves the image, then updates its memory, whose hidden state is the output."""

    def __init__(self, channels: int, out: int, recurrent: str, norm: str | None) -> None:
        super().__init__()
        self.conv = _Conv(channels, out, 5, norm=norm, stride=2)
        self.recurrent_block = _ConvLSTM(out) if recurrent == "convlstm" else _ConvGRU(out)

    def forward(self, x: Tensor, state: State) -> State:
        return self.recurrent_block(functional.relu_(self.conv(x)), state)


class _ConvLSTM(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.Gates = nn.Conv2d(2 * channels, 4 * channels, 3, padding=1)

    def forward(self, x: Tensor, state: State) -> State:
        # The memory keeps the precision of the weights even if convolutions use less.
        hidden, cell = state or 2 * (torch.zeros_like(x, dtype=self.Gates.weight.dtype),)
        gates = self.Gates(torch.cat([x, hidden.to(x.dtype)], dim=1))
        if torch.is_grad_enabled():
            return _remember(gates, cell)
        # By bands of rows: new memory for nine images at once costs more than the arithmetic.
        new = torch.empty_like(cell), torch.empty_like(cell)
        rows = max(1, _BAND // (gates.shape[1] * gates.shape[3]))
        for parts in zip(*(x.split(rows, dim=2) for x in (*new, gates, cell)), strict=True):
            for target, state_part in zip(parts[:2], _remember(*parts[2:]), strict=True):
                target.copy_(state_part)
        return new


def _remember(gates: Tensor, cell: Tensor) -> State:
    """Return the hidden and the cell state of an LSTM after its gates."""
    take, keep, out, candidate = gates.to(cell.dtype).chunk(4, dim=1)
    cell = torch.sigmoid(keep) * cell + torch.sigmoid(take) * torch.tanh(candidate)
    return torch.sigmoid(out) * torch.tanh(cell), cell


class _ConvGRU(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.reset_gate = nn.Conv2d(2 * channels, channels, 3, padding=1)
        self.update_gate = nn.Conv2d(2 * channels, channels, 3, padding=1)
        self.out_gate = nn.Conv2d(2 * channels, channels, 3, padding=1)

    def forward(self, x: Tensor, state: State) -> State:
        (hidden,) = state or (torch.zeros_like(x, dtype=self.out_gate.weight.dtype),)
        both = torch.cat([x, hidden.to(x.dtype)], dim=1)
        update, reset = torch.sigmoid(self.update_gate(both)), torch.sigmoid(self.reset_gate(both))
        candidate = self.out_gate(torch.cat([x, (hidden * reset).to(x.dtype)], dim=1))
        return (hidden * (1 - update) + torch.tanh(candidate) * update,)


class _ResidualBlock(nn.Module):
    def __init__(self, channels: int, norm: str | None) -> None:
        super().__init__()
        bias = norm != "BN"
        self.conv1 = nn.Conv2d(channels, channels, 3, padding=1, bias=bias)
        self.bn1 = _normalization(norm, channels, with_statistics=False)
        self.bn2 = _normalization(norm, channels, with_statistics=False)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1, bias=bias)

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu_(self.bn1(self.conv1(x)))
        return functional.relu_(x + self.bn2(self.conv2(y)))
