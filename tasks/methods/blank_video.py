"""The do-nothing baseline of video: an image of one level."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sensor import Events


class BlankVideo:
    """Shows the same everywhere and always, whatever the events say."""

    def __init__(self, width: int, height: int, contrast_threshold: float) -> None:
        self._shape = height, width

    def push(self, events: Events) -> None:
        """Ignore them."""

    def image(self, t_us: int) -> NDArray[np.float64]:
        """Zeros, (height, width)."""
        return np.zeros(self._shape)
