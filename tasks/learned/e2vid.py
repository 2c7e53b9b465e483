"""E2VID with its weights, ready to run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from tasks.errors import WeightsError
from tasks.learned import cpu
from tasks.learned.checkpoint import held, read_checkpoint, tensors_of, with_weights
from tasks.learned.e2vid_network import E2vidOptions, E2VIDRecurrent, State

ARCHITECTURE = "E2VIDRecurrent"
_ROOT = "unetrecurrent."
# Peak memory per pixel and per channel at full resolution. Measured in float32 at 480 px: 46, and
# 62 for a decoder that enlarges what it concatenates.
_BYTES_PER_PX_AND_CHANNEL = 60
_BYTES_OF_ENLARGED = 80
KEPT_BYTES_PER_PX = 40  # the last image, and four sums of events of our network


class E2vidNetwork:
    """E2VID with its weights; the last `sums` input channels are not bins of a voxel grid."""

    normalized = True
    _padding = "reflect"

    def __init__(self, network: E2VIDRecurrent, name: str = "e2vid", sums: int = 0) -> None:
        options, base = network.options, network.options.base_num_channels
        self._network, self._name = network.eval(), name
        self.bins = options.num_bins - sums
        self._multiple = 2**options.num_encoders
        is_enlarged = options.use_upsample_conv or options.skip_type == "concat"
        per_channel = _BYTES_OF_ENLARGED if is_enlarged else _BYTES_PER_PX_AND_CHANNEL
        self._bytes_per_px = per_channel * base
        parts = 2 if options.recurrent_block_type == "convlstm" else 1  # hidden, and cell
        coarser = 1 - 2.0**-options.num_encoders  # the sum over levels i of 2^i channels, 4^-i px
        self._kept_bytes_per_px = 4 * parts * base * coarser + KEPT_BYTES_PER_PX

    def check_size(self, width: int, height: int) -> None:
        """Refuse a sensor for which the network needs more memory than this machine has."""
        cpu.check_memory(self._name, width, height, self._bytes_per_px * width * height)

    def kept_bytes(self, width: int, height: int) -> int:
        """Return what a sensor keeps between windows; the events of a window come on top."""
        return round(self._kept_bytes_per_px * width * height)

    def image(
        self, grid: NDArray[np.float32], states: Sequence[State] | None = None
    ) -> tuple[NDArray[np.float32], Sequence[State]]:
        """Return the image of a window, and the states for the next window.

        Grid: (bins + sums, height, width). Image: (height, width), as on a display, in [0, 1].
        """
        return cpu.run(self._image, grid, states)

    def _image(
        self, grid: NDArray[np.float32], states: Sequence[State] | None
    ) -> tuple[NDArray[np.float32], Sequence[State]]:
        height, width = grid.shape[1:]
        whole = padded(torch.from_numpy(grid)[None], self._multiple, self._padding)
        image, states = self._network(whole, states)
        top, left = (whole.shape[-2] - height + 1) // 2, (whole.shape[-1] - width + 1) // 2
        inside = image[0, 0, top : top + height, left : left + width]
        return inside.float().clamp(0, 1).numpy(), states


def padded(grid: Tensor, multiple: int, mode: str) -> Tensor:
    """Pad (..., H, W) to a multiple of a number, the larger half on the left and at the top."""
    height, width = grid.shape[-2:]
    more = (-width % multiple, -height % multiple)
    sides = [side for total in more for side in ((total + 1) // 2, total // 2)]
    return functional.pad(grid, sides, mode) if any(sides) else grid


def load(file: Path) -> E2vidNetwork:
    """Read E2VID's weights from a checkpoint as published, a table with `arch` and `state_dict`."""
    content = read_checkpoint(file)
    if not isinstance(content, Mapping) or "state_dict" not in content:
        raise WeightsError(f"{file}: found {held(content)}, expected arch and state_dict of E2VID")
    if content.get("arch", ARCHITECTURE) != ARCHITECTURE:
        raise WeightsError(f"{file}: arch: found {content['arch']!r}, expected {ARCHITECTURE!r}")
    return e2vid_of(tensors_of(content["state_dict"], file), file)


def e2vid_of(
    state: Mapping[str, Tensor], file: Path, name: str = "e2vid", sums: int = 0
) -> E2vidNetwork:
    """Return a network with weights, whose shapes tell its options."""
    network = with_weights(partial(E2VIDRecurrent, options_of(state, file)), state, file)
    return E2vidNetwork(network, name, sums)


def options_of(state: Mapping[str, Tensor], file: Path) -> E2vidOptions:
    """Return the options of the network to which weights belong."""

    def count(start: str, end: str) -> int:
        names = (f"{_ROOT}{start}.{i}.{end}" for i in range(len(state)))
        return next(i for i, name in enumerate(names) if name not in state)

    head, pred = (state.get(f"{_ROOT}{name}.conv2d.weight") for name in ("head", "pred"))
    encoders = count("encoders", "conv.conv2d.weight")
    if head is None or pred is None or head.ndim != 4 or pred.ndim != 4 or not encoders:
        raise WeightsError(f"{file}: found {held(state)}, expected the weights of E2VID")
    base, bins = head.shape[:2]
    norm = None
    if f"{_ROOT}encoders.0.conv.norm_layer.running_mean" in state:
        norm = "BN" if f"{_ROOT}encoders.0.conv.norm_layer.weight" in state else "IN"
    is_lstm = f"{_ROOT}encoders.0.recurrent_block.Gates.weight" in state
    return E2vidOptions(
        num_bins=bins,
        skip_type="concat" if pred.shape[1] == 2 * base else "sum",
        recurrent_block_type="convlstm" if is_lstm else "convgru",
        num_encoders=encoders,
        base_num_channels=base,
        num_residual_blocks=count("resblocks", "conv1.weight"),
        norm=norm,
        use_upsample_conv=f"{_ROOT}decoders.0.conv2d.weight" in state,
    )
