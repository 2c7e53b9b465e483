"""Files of the weights of our own networks, trained by `eres train`, in half precision."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from torch import Tensor, nn

from tasks.errors import WeightsError
from tasks.learned.checkpoint import held, read_checkpoint, tensors_of, write_checkpoint
from tasks.learned.e2vid import E2vidNetwork, e2vid_of
from tasks.learned.eraft import ERaft, eraft_of
from tasks.methods.our_reconstruction import DECAYS

RECONSTRUCTION, FLOW = "eres reconstruction", "eres flow"
"""Names of the architectures in files."""


def save(
    file: Path, network: nn.Module, architecture: str, light: str, origin: Mapping[str, int]
) -> None:
    """Write weights in half precision; the light of the training crops is "ideal" or "all"."""
    weights = dict(copy.deepcopy(network).half().cpu().state_dict())
    content = {"arch": architecture, "light": light, "origin": dict(origin), "weights": weights}
    write_checkpoint(file, content)


def _reconstruction(file: Path, light: str) -> E2vidNetwork:
    state = _weights(file, RECONSTRUCTION, light)
    return e2vid_of(state, file, "our reconstruction", len(DECAYS))  # the last are sums of events


def _flow(file: Path, light: str) -> ERaft:
    return eraft_of(_weights(file, FLOW, light), file, "our flow")


# Each reads a file that `save` wrote, and raises `WeightsError` if it cannot be read or is of
# another network or light.
reconstruction_ideal_light = partial(_reconstruction, light="ideal")
reconstruction_all_light = partial(_reconstruction, light="all")
flow_ideal_light = partial(_flow, light="ideal")
flow_all_light = partial(_flow, light="all")


def _weights(file: Path, architecture: str, light: str) -> dict[str, Tensor]:
    content = read_checkpoint(file)
    if not isinstance(content, Mapping) or "weights" not in content:
        raise WeightsError(f"{file}: found {held(content)}, expected arch, light and weights")
    for name, expected in (("arch", architecture), ("light", light)):
        value = content.get(name)
        if value != expected:
            raise WeightsError(f"{file}: {name}: found {value!r}, expected {expected!r}")
    return tensors_of(content["weights"], file)
