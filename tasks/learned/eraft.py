"""E-RAFT with its weights, ready to run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tasks.errors import WeightsError
from tasks.learned import cpu
from tasks.learned.checkpoint import check_bins, held, load_into, read_checkpoint, tensors_of
from tasks.learned.eraft_network import ERAFT, ITERATIONS
from tasks.learned.size import check_memory

# Images are padded to multiples of 32 px. At 96 px the coarsest level of the correlation has one
# cell and nothing to interpolate; between, much of an image would be padding.
MIN_PX = 128
# At the peak. Measured: 650 in float32 at 640x480 px with one update, without the grids of events;
# the process in docs/learned.md has 1050 at 1280 px, of which PyTorch itself is a part.
_BYTES_PER_PX = 850
_FIRST = "fnet.conv1.weight"
# The published code stores one normalization under both names.
_TWICE = tuple((f"cnet.layer{i}.0.norm3.", f"cnet.layer{i}.0.downsample.1.") for i in (2, 3))


class ERaft:
    """E-RAFT with its weights."""

    def __init__(self, network: ERAFT, bins: int, name: str = "eraft") -> None:
        self._network, self.bins, self._name = network.eval(), bins, name

    def check_size(self, width: int, height: int) -> None:
        """Check that the network can run on a sensor.

        Parameters
        ----------
        width, height
            Size of the sensor, px.
        """
        if min(width, height) < MIN_PX:
            raise WeightsError(
                f"{self._name}: found a sensor of {width}x{height} px, expected at least "
                f"{MIN_PX} px on each side"
            )
        check_memory(self._name, width, height, _BYTES_PER_PX * width * height)

    def kept_bytes(self, width: int, height: int) -> int:
        """Return what a sensor keeps between windows besides events.

        Parameters
        ----------
        width, height
            Size of the sensor, px.
        """
        return 0

    def flow(
        self, old: NDArray[np.float32], new: NDArray[np.float32], iterations: int = ITERATIONS
    ) -> NDArray[np.float32]:
        """Return the flow over the new window.

        Parameters
        ----------
        old, new
            (bins, height, width) voxel grids of the window before, and of the window itself.

        Returns
        -------
        (2, height, width) px, x first.
        """
        return cpu.run(self._flow, old, new, iterations)

    def _flow(
        self, old: NDArray[np.float32], new: NDArray[np.float32], iterations: int
    ) -> NDArray[np.float32]:
        grids = (torch.from_numpy(grid)[None] for grid in (old, new))
        _, full = self._network(*grids, iterations)
        found: NDArray[np.float32] = full[-1][0].numpy()
        return found


def load(file: Path) -> ERaft:
    """Read E-RAFT's weights."""
    found = read_checkpoint(file)
    model = found.get("model") if isinstance(found, Mapping) else None
    if not isinstance(model, Mapping) or _FIRST not in model:
        raise WeightsError(f"{file}: found {held(found)}, expected the weights of E-RAFT as model")
    state = _with_both_names(tensors_of(model, file), file)
    if state[_FIRST].ndim != 4:
        raise WeightsError(f"{file}: {_FIRST}: found {state[_FIRST].ndim} axes, expected 4")
    bins = check_bins(state[_FIRST].shape[1], file)
    with torch.device("meta"):
        network = ERAFT(bins)
    load_into(network, state, file)
    return ERaft(network, bins)


def _with_both_names(state: dict[str, Tensor], file: Path) -> dict[str, Tensor]:
    """Return the weights, with both names for those that have two."""
    whole = dict(state)
    for starts in _TWICE:
        for start, other in (starts, starts[::-1]):
            for name in [name for name in state if name.startswith(start)]:
                twin = other + name.removeprefix(start)
                if not torch.equal(whole.setdefault(twin, state[name]), state[name]):
                    raise WeightsError(
                        f"{file}: found other values of {twin} than of {name}, expected the same"
                    )
    return whole
