"""Objects of a scene that move: which shapes belong to each, and where it is at any time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eres_render.errors import TrajectoryError, reading
from eres_render.trajectory.spline import Trajectory, path_through
from eres_render.trajectory.tum import read_tum

MAX_OBJECTS = 255  # their numbers fit into a byte, and 0 is the still world

_CLOCK_S = 1e-6  # the clock of the camera's path starts at a whole microsecond


@dataclass(frozen=True, eq=False, slots=True)
class MovingObject:
    """A rigid object on its own path; with the identity as pose it is where scene.xml puts it.

    `shapes` are ids. `path` has T_world_object by the time since `start_s`, which is on the time
    axis of the camera's path and not after 0.
    """

    name: str
    shapes: tuple[str, ...]
    path: Trajectory
    start_s: float

    def pose(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Return T_world_object, (..., 4, 4), at times (...) of the camera's path, s."""
        return self.path.pose(np.asarray(t_s, np.float64) - self.start_s)

    @property
    def knots_s(self) -> NDArray[np.float64]:
        """Times of the camera's path between which the motion is smooth, (N,) s."""
        return self.path.knots_s + self.start_s


def read_object(
    name: str, shapes: tuple[str, ...], file: Path, t_offset_us: int, duration_s: float
) -> MovingObject:
    """Read the path of an object from T_world_object in TUM format, on the camera path's clock.

    The camera's path starts at `t_offset_us` on that clock and lasts `duration_s`.
    """
    t_s, poses = read_tum(file, t_offset_us)
    if t_s[0] > _CLOCK_S or t_s[-1] < duration_s - _CLOCK_S:
        raise TrajectoryError(
            f"{file}: the path of object {name!r} covers {t_s[0]:g} to {t_s[-1]:g} s, but the "
            f"camera's path covers 0 to {duration_s:g} s; add poses"
        )
    t_s[0], t_s[-1] = min(t_s[0], 0.0), max(t_s[-1], duration_s)
    with reading(file, "text", TrajectoryError):
        path = path_through(t_s, poses)
    return MovingObject(name, shapes, path, float(t_s[0]))
