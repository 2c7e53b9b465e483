"""Random motion of a camera in front of a plane: homographies, and the flow that they cause."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

_WAVES = 2  # for each coordinate
_PERIODS = (12.0, 60.0)  # windows: 0.3 to 1.5 s for windows of 25 ms
_SHARE_OF_WAVES = 0.7  # in the speed; the rest is steady
_SAMPLES = 8  # in a window, to find how fast the corners move


def _path(
    rng: np.random.Generator, start: float, speed: float, steady: float, largest: float = math.inf
) -> Callable[[Float64], Float64]:
    """Draw a coordinate over time: steady motion, and waves around it."""
    shortest, longest = map(math.log, _PERIODS)
    rates = 2 * math.pi / np.exp(rng.uniform(shortest, longest, _WAVES))
    amplitudes = np.minimum(speed * rng.uniform(0.5, 1.0, _WAVES) / rates, largest)
    phases = rng.uniform(0, 2 * math.pi, _WAVES)
    return lambda t: start + steady * t + np.sin(rates * t[..., None] + phases) @ amplitudes


class Motion:
    """A smooth random motion of a plane in a square image; time is in windows.

    Homographies map pixels, (0, 0) at the top-left corner of the image and centers at integers +
    0.5, to texels in the same convention. `motion_px` is the approximate mean motion, px per
    window, and `texels_per_px` is the scale at time 0 without the waves.
    """

    def __init__(
        self, rng: np.random.Generator, side_px: int, motion_px: float, texels_per_px: float
    ) -> None:
        self._side_px, self._scale = side_px, texels_per_px
        half_px = side_px / 2
        direction = rng.uniform(0, 2 * math.pi)
        steady = motion_px * texels_per_px * (1 - _SHARE_OF_WAVES)
        waves = motion_px * texels_per_px * _SHARE_OF_WAVES
        self._center = [
            _path(rng, rng.uniform(0, 512), waves, steady * part)
            for part in (math.cos(direction), math.sin(direction))
        ]
        turn = rng.uniform(0, 0.4) * motion_px / half_px
        self._angle = _path(rng, rng.uniform(0, 2 * math.pi), turn, 0.0)
        zoom = rng.uniform(0, 0.3) * motion_px / half_px
        self._log_zoom = _path(rng, 0.0, zoom, 0.0, largest=0.12)
        tilt = rng.uniform(0, 0.2) * motion_px / half_px**2
        self._tilt = [
            _path(rng, rng.uniform(-0.15, 0.15) / half_px, tilt, 0.0, largest=0.05 / half_px)
            for _ in range(2)
        ]

    def homographies(self, t: Float64, side_px: int | None = None) -> Float64:
        """Return the homographies from pixels to texels, (N, 3, 3), at times in windows, (N,).

        `side_px` is the side of another square image with the same middle.
        """
        x, y = (path(t) for path in self._center)
        gx, gy = (path(t) for path in self._tilt)
        size = self._scale * np.exp(self._log_zoom(t))
        a, b = size * np.cos(self._angle(t)), size * np.sin(self._angle(t))
        # (a, -b; b, a) p / (1 + g p) + center, with p from the middle of the image
        first, second = [a + x * gx, -b + x * gy, x], [b + y * gx, a + y * gy, y]
        around_middle = np.moveaxis(np.array([first, second, [gx, gy, np.ones_like(t)]]), -1, 0)
        to_middle = np.eye(3)
        to_middle[:2, 2] = -(side_px or self._side_px) / 2
        return around_middle @ to_middle

    def flow(self, start: float, end: float) -> NDArray[np.float32]:
        """Return how far points at pixels' centers at `start` move, (2, side, side) px, x first."""
        before, after = self.homographies(np.array([start, end]))
        centers = np.arange(self._side_px) + 0.5
        points = np.stack(np.meshgrid(centers, centers))
        return (_moved(np.linalg.solve(after, before), points) - points).astype(np.float32)

    def fastest_px(self, window: int) -> float:
        """Return the largest speed of a corner of the image in a window, px per window."""
        maps = self.homographies(window + np.linspace(0, 1, _SAMPLES + 1))
        ends = [0.0, float(self._side_px)]
        corners = np.array([[x, y] for x in ends for y in ends]).T
        steps = np.linalg.solve(maps[1:], maps[:-1])
        return max(
            _SAMPLES * float(np.linalg.norm(_moved(step, corners) - corners, axis=0).max())
            for step in steps
        )


def _moved(homography: Float64, points: Float64) -> Float64:
    """Apply a homography to points, (2, ...)."""
    x, y, w = np.tensordot(homography, np.stack([*points, np.ones_like(points[0])]), axes=1)
    return np.stack([x / w, y / w])
