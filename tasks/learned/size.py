"""Refuse sensors for which networks need more memory than this machine has."""

from __future__ import annotations

from collections.abc import Mapping

from sensor.engine.arguments import memory_bytes
from tasks.errors import WeightsError


def check_memory(name: str, width: int, height: int, needed: int) -> None:
    """Check that a network fits into memory.

    Parameters
    ----------
    name
        Name of the network, for the error.
    width, height
        Size of the image, px.
    needed
        Memory that it needs, bytes.

    Raises
    ------
    WeightsError
        The network needs more memory than this machine has; the message gives both.
    """
    if needed > (there := memory_bytes()):
        raise WeightsError(
            f"{name}: at {width}x{height} px it needs {needed / 1e9:.1f} GB of memory, and this "
            f"machine has {there / 1e9:.1f} GB; choose a smaller sensor"
        )


def check_kept(kept: Mapping[str, int], sensors: int) -> None:
    """Check that what networks keep for all sensors at a time fits into memory.

    Parameters
    ----------
    kept
        What each network keeps for all sensors together, bytes, by its name.
    sensors
        Number of sensors, each counted once for each light and speed.

    Raises
    ------
    WeightsError
        It does not fit; the message gives the networks and both sizes.
    """
    if (needed := sum(kept.values())) > (there := memory_bytes()):
        raise WeightsError(
            f"{' and '.join(kept)}: for {sensors} sensors (one for each light and speed) networks "
            f"keep {needed / 1e9:.1f} GB in memory, and this machine has {there / 1e9:.1f} GB; "
            "choose fewer or smaller sensors, or run one network at a time"
        )
