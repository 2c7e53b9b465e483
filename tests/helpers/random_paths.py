"""Random paths of a camera."""

import numpy as np

from eres_render import Trajectory
from eres_render.trajectory.generators import random_path


def hand_held_path(
    duration_s: float, knot_interval_s: float, turn_rad: float, seed: int
) -> Trajectory:
    """Return a path at 1 m/s that sways and turns about all axes, from the origin."""
    return random_path(
        np.eye(4),
        duration_s=duration_s,
        mean_speed_mps=1.0,
        knot_interval_s=knot_interval_s,
        sway=(1, 1, 1),
        turn_rad=(turn_rad,) * 3,
        seed=seed,
    )
