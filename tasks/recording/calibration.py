"""`Calibration`: the lens of a camera, from a file as in the RPG's event camera dataset.

The file is one line `fx fy cx cy k1 k2 p1 p2 k3`, in pixels and with OpenCV's distortion; (0, 0) is
the center of the top-left pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

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
        import cv2

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
        names = f"{' '.join(_NAMES)} (k3 is optional; fx and fy are above 0)"
        raise TaskError(f"{path}: found {len(text)} words, expected the finite numbers {names}")
    for name, center, side in zip(("cx", "cy"), numbers[2:4], size, strict=True):
        middle = (side - 1) / 2
        if abs(center - middle) > _FARTHEST * side:
            sensor = f"{middle:g} px, the middle of the {size[0]}x{size[1]} sensor"
            raise TaskError(f"{path}, {name}: found {center:g} px, expected about {sensor}")
    fx, fy, cx, cy = numbers[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Calibration(K, np.resize(np.append(numbers[4:], 0.0), 5))
