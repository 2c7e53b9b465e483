"""All frames of footage have the size of the first."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.errors import TaskError


def check_size(
    numbers: NDArray[np.generic], first: tuple[int, ...], place: object, like: str
) -> None:
    """Check that a frame has the size of the first.

    Parameters
    ----------
    numbers
        (H, W, ...) its pixel values.
    first
        Height and width of the first, px.
    """
    if numbers.shape[:2] != first:
        raise TaskError(
            f"{place}: found {numbers.shape[1]}x{numbers.shape[0]} px, expected {first[1]}x"
            f"{first[0]} px, {like}"
        )
