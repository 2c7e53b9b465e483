"""FireNet and FireNet+ with their weights, ready to run.

Both are one network. They differ in training (Stoffregen et al., "Reducing the Sim-to-Real Gap for
Event Cameras", ECCV 2020, for FireNet+), in the names of their weights, and in the input: FireNet's
is normalized, and padded with zeros to multiples of 16 px.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from tasks.errors import WeightsError
from tasks.learned.checkpoint import held, read_checkpoint, tensors_of, with_weights
from tasks.learned.e2vid import KEPT_BYTES_PER_PX, E2vidNetwork
from tasks.learned.e2vid_network import FireNet

# How names of weights start in files, for each part of the network in turn.
_STARTS = {
    "firenet": (
        *("net.head.conv.", "net.head.recurrent_block.", "net.resblocks.0.conv."),
        *("net.resblocks.0.recurrent_block.", "net.resblocks.1.", "net.pred."),
    ),
    "firenet_plus": ("head.", "G1.", "R1.", "G2.", "R2.", "pred."),
}
# The published file of FireNet+ holds the configuration of its training as such objects.
_LEFT_OUT = "parse_config.ConfigParser", "pathlib.PosixPath"


class FireNetNetwork(E2vidNetwork):
    """FireNet or FireNet+ with its weights."""

    _padding = "constant"
    _bytes_per_px = 750  # at the peak; measured in float32 at 1280 px: 740, part of it PyTorch
    _kept_bytes_per_px = 4 * FireNet.memories * FireNet.channels + KEPT_BYTES_PER_PX

    def __init__(self, network: FireNet, name: str) -> None:
        self._network, self._name, self.bins = network.eval(), name, network.bins
        self.normalized = name == "firenet"
        self._multiple = 16 if self.normalized else 1


def _load(file: Path, name: str) -> FireNetNetwork:
    content = read_checkpoint(file, _LEFT_OUT)
    is_published = isinstance(content, Mapping) and "state_dict" in content
    state = tensors_of(content["state_dict"] if is_published else content, file)
    of = next((k for k, starts in _STARTS.items() if all(n.startswith(starts) for n in state)), "")
    if of != name:
        option = f"; for weights of {of} give --weights {of}=FILE" if of else ""
        raise WeightsError(f"{file}: found {held(state)}, expected the weights of {name}{option}")
    ours = dict(zip(_STARTS[name], _STARTS["firenet_plus"], strict=True))
    renamed = {
        ours[start] + key.removeprefix(start): tensor
        for key, tensor in state.items()
        for start in ours
        if key.startswith(start)
    }
    return FireNetNetwork(with_weights(FireNet, renamed, file), name)


# Each reads a published file, or its tensors by name alone.
firenet = partial(_load, name="firenet")
firenet_plus = partial(_load, name="firenet_plus")
