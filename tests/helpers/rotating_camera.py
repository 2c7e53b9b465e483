"""A camera that turns about an axis through its center, before a distant texture."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from moving_texture import texture_in_motion


@dataclass(frozen=True)
class Rotation:
    """Light of a turning camera, and the true motion of its image."""

    light: np.ndarray  # (T, 2 H, 2 W) radiance
    t_s: np.ndarray  # (T,)
    motion: Callable[[np.ndarray, float], np.ndarray]  # of a place, px, in so many seconds, px


def rotating_camera(axis, rad_s, duration_s, frames, size=(128, 96), seed=1):
    """Turn a camera, whose focal length is its width, by a steady angle per second."""
    width, height = size
    K = np.array([[width, 0, 0.5 * width], [0, width, 0.5 * height], [0, 0, 1.0]])
    back = np.linalg.inv(K)
    views, _ = texture_in_motion(seed, 2, (3 * height, 3 * width), 1.0)
    texture_px = np.array([[2, 0, 0.5 * width], [0, 2, 0.5 * height], [0, 0, 1]])
    half_px = np.array([[0.5, 0, 0.25], [0, 0.5, 0.25], [0, 0, 1]])  # of frames twice as fine
    index = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])

    def turned(t_s):
        angles = rad_s * t_s * np.array(axis, float)
        return K @ cv2.Rodrigues(angles)[0] @ back

    t_s = np.linspace(0, duration_s, frames)
    light = np.stack(
        [
            cv2.warpPerspective(
                *(views[0], index @ texture_px @ turned(one) @ half_px, (2 * width, 2 * height)),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REFLECT,
            )
            for one in t_s - 0.5 * duration_s
        ]
    )

    def motion(place_px, span_s):
        x, y, depth = turned(-span_s) @ [*place_px, 1]
        return np.array([x, y]) / depth - place_px

    return Rotation(light, t_s, motion)
