"""`Calibration`: the lens of a camera, from a file as in the RPG's event camera dataset.

The file is one line `fx fy cx cy k1 k2 p1 p2 k3`, in pixels and with OpenCV's distortion; (0, 0) is
the center of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import reading
from tasks.errors import TaskError

_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_FARTHEST = 0.2  # distance of the principal point from the middle, in widths and heights


@dataclass(frozen=True, eq=False, slots=True)
class Calibration:
    """A pinhole camera with distortion.

    Parameters
    ----------
    K
        (3, 3) camera matrix, px.
    distortion
        (5,) k1, k2, p1, p2 and k3.
    """

    K: NDArray[np.float64]
    distortion: NDArray[np.float64]

    def undistorted(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return an image as the pinhole camera would see it; black outside."""
        return np.asarray(cv2.undistort(image, self.K, self.distortion))


def read_calibration(path: Path, size: tuple[int, int]) -> Calibration:
    """Read a calibration.

    Parameters
    ----------
    size
        Width and height of the sensor, px.
    """
    with reading(path, "text", TaskError):
        text = path.read_text(encoding="utf-8", errors="replace").split()
    try:
        numbers = np.array([float(word) for word in text])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) not in (8, 9) or not np.isfinite(numbers).all() or min(numbers[:2]) <= 0:
        raise TaskError(
            f"{path}: found {len(text)} words, expected the numbers {' '.join(_NAMES)}, of which "
            "k3 may be missing"
        )
    for name, center, side in (("cx", numbers[2], size[0]), ("cy", numbers[3], size[1])):
        if abs(center - (side - 1) / 2) > _FARTHEST * side:
            raise TaskError(
                f"{path}, {name}: found {center:g} px, expected about {(side - 1) / 2:g} px, the "
                f"middle of the sensor of {size[0]}x{size[1]} px: is it of the same camera?"
            )
    fx, fy, cx, cy = numbers[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Calibration(K, np.resize(np.append(numbers[4:], 0.0), 5))
