"""The do-nothing baseline of video: a uniform image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensor import Events


class BlankVideo:
    """Returns the same uniform image at any time, whatever the events are."""

    def __init__(self, width: int, height: int, contrast_threshold: float) -> None:
        self._shape = height, width

    def push(self, events: Events) -> None:
        """Ignore the events."""

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Return zeros, (height, width)."""
        return np.zeros(self._shape)
