"""E-RAFT with its weights, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tasks.errors import WeightsError
from tasks.learned import cpu
from tasks.learned.checkpoint import held, read_checkpoint, tensors_of, with_weights
from tasks.learned.eraft_network import ERAFT, ITERATIONS

Float32 = NDArray[np.float32]

# Images are padded to multiples of 32 px. At 96 px the coarsest level of the correlation has one
# cell and nothing to interpolate; between, much of an image would be padding.
MIN_PX = 128
# At the peak. Measured: 650 in float32 at 640x480 px with one update, without the grids of events;
# the process in docs/learned.md has 1050 at 1280 px, of which PyTorch itself is a part.
_BYTES_PER_PX = 850
_FIRST = "fnet.conv1.weight"
_CHANNELS = 64  # of the first layer as published


class ERaft:
    """E-RAFT with its weights."""

    def __init__(self, network: ERAFT, bins: int, name: str = "eraft") -> None:
        self._network, self.bins, self._name = network.eval(), bins, name

    def check_size(self, width: int, height: int) -> None:
        """Refuse a sensor that has a side below `MIN_PX`, or needs too much memory."""
        if min(width, height) < MIN_PX:
            raise WeightsError(
                f"{self._name}: found a sensor of {width}x{height} px, expected at least "
                f"{MIN_PX} px on each side"
            )
        cpu.check_memory(self._name, width, height, _BYTES_PER_PX * width * height)

    def kept_bytes(self, width: int, height: int) -> int:
        """Return what a sensor keeps between windows besides events."""
        return 0

    def flow(self, old: Float32, new: Float32, iterations: int = ITERATIONS) -> Float32:
        """Return the (2, h, w) flow over the new window, px, x first, from (bins, h, w) grids."""
        grids = (torch.from_numpy(grid)[None] for grid in (old, new))
        (full,) = cpu.run(self._network, *grids, iterations)
        return full[0].numpy()


def load(file: Path) -> ERaft:
    """Read E-RAFT's weights."""
    content = read_checkpoint(file)
    model = content.get("model") if isinstance(content, Mapping) else None
    if not isinstance(model, Mapping) or _FIRST not in model:
        raise WeightsError(
            f"{file}: found {held(content)}; expected an entry 'model' with the weights of E-RAFT"
        )
    return eraft_of(tensors_of(model, file), file)


def eraft_of(state: Mapping[str, Tensor], file: Path, name: str = "eraft") -> ERaft:
    """Return a network with weights, which divides the published numbers of channels."""
    shape = tuple(state[_FIRST].shape) if _FIRST in state else ()
    if len(shape) != 4:
        raise WeightsError(f"{file}: {_FIRST}: found shape {shape}, expected four axes")
    narrower = _CHANNELS // max(4, shape[0]) or 1  # 1 to 16; all shapes are compared next
    return ERaft(with_weights(partial(ERAFT, shape[1], narrower), state, file), shape[1], name)
