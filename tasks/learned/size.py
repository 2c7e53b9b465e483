"""Refuse images for which a network needs more memory than this machine has."""

from __future__ import annotations

from sensor.memory import memory_bytes
from tasks.errors import WeightsError


def check_memory(name: str, width: int, height: int, needed: int) -> None:
    """Check that a network fits into memory.

    Parameters
    ----------
    width, height
        Size of the image, px.
    needed
        Memory that it needs, bytes.
    """
    if needed > (there := memory_bytes()):
        raise WeightsError(
            f"{name}: at {width}x{height} px it needs {needed / 1e9:.1f} GB of memory, and this "
            f"machine has {there / 1e9:.1f} GB; choose a smaller sensor"
        )
