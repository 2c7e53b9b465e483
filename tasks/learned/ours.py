"""Files of the weights of our own networks, trained by `eres train`, in half precision."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn

from tasks.errors import WeightsError
from tasks.learned.checkpoint import (
    check_bins,
    held,
    load_into,
    read_checkpoint,
    tensors_of,
    write_checkpoint,
)
from tasks.learned.e2vid import E2vidNetwork, options_of
from tasks.learned.e2vid_network import E2VIDRecurrent
from tasks.learned.eraft import ERaft
from tasks.learned.eraft_network import ERAFT
from tasks.methods.our_reconstruction import DECAYS

RECONSTRUCTION, FLOW = "eres reconstruction", "eres flow"
"""Names of the architectures in files."""

_FIRST = "fnet.conv1.weight"
_CHANNELS = 64  # of E-RAFT's first layer as published


class OurReconstructionNetwork(E2vidNetwork):
    """Our network for reconstruction, with its weights; see `tasks.methods.our_reconstruction`."""

    @property
    def bins(self) -> int:
        """Bins of the voxel grids; the network has more input channels, for sums of events."""
        return super().bins - len(DECAYS)


def save(
    file: Path,
    network: nn.Module,
    architecture: str,
    light: str,
    origin: Mapping[str, str | int | float],
) -> None:
    """Write weights in half precision.

    Parameters
    ----------
    light
        "ideal" or "all": the light of the crops on which it was trained.
    """
    weights = {
        name: tensor.cpu().half() if tensor.is_floating_point() else tensor.cpu()
        for name, tensor in network.state_dict().items()
    }
    content = {"arch": architecture, "light": light, "origin": dict(origin), "weights": weights}
    write_checkpoint(file, content)


def _reconstruction(file: Path, light: str) -> OurReconstructionNetwork:
    state = _weights(file, RECONSTRUCTION, light)
    options = options_of(state, file)
    if options.num_bins < len(DECAYS) + 2:
        raise WeightsError(
            f"{file}: found {options.num_bins} input channels, expected at least "
            f"{len(DECAYS) + 2}: {len(DECAYS)} sums of events, and 2 bins"
        )
    with torch.device("meta"):
        network = E2VIDRecurrent(options)
    load_into(network, state, file)
    return OurReconstructionNetwork(network, "our reconstruction")


def _flow(file: Path, light: str) -> ERaft:
    state = _weights(file, FLOW, light)
    shape = tuple(state[_FIRST].shape) if _FIRST in state else ()
    narrower = [n for n in (1, 2, 4, 8, 16) if len(shape) == 4 and shape[0] == _CHANNELS // n]
    if not narrower:
        raise WeightsError(
            f"{file}: {_FIRST}: found shape {shape}, expected four axes, the first of 64, "
            "32, 16, 8 or 4"
        )
    bins = check_bins(shape[1], file)
    with torch.device("meta"):
        network = ERAFT(bins, narrower[0])
    load_into(network, state, file)
    return ERaft(network, bins, "our flow")


# Each reads a file that `save` wrote, and raises `WeightsError` if it cannot be read or is of
# another network or light.
reconstruction_ideal_light = partial(_reconstruction, light="ideal")
reconstruction_all_light = partial(_reconstruction, light="all")
flow_ideal_light = partial(_flow, light="ideal")
flow_all_light = partial(_flow, light="all")


def _weights(file: Path, architecture: str, light: str) -> dict[str, Tensor]:
    found = read_checkpoint(file)
    if not isinstance(found, Mapping) or "weights" not in found:
        raise WeightsError(f"{file}: found {held(found)}, expected arch, light and weights")
    for name, expected in (("arch", architecture), ("light", light)):
        if found.get(name) != expected:
            raise WeightsError(f"{file}: {name}: found {found.get(name)!r}, expected {expected!r}")
    return tensors_of(found["weights"], file)
