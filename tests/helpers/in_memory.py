"""Footage in memory."""

from pathlib import Path

import numpy as np

from tasks.footage import Footage


def footage_of(frames, step_s=1.0):
    """Return frames of light as footage, white at 1."""
    return Footage(
        path=Path("memory"),
        t_s=step_s * np.arange(len(frames)),
        t_offset_us=0,
        height=frames[0].shape[0],
        width=frames[0].shape[1],
        encoding="linear",
        white_level=1.0,
        frames=lambda: iter(frames),
    )
