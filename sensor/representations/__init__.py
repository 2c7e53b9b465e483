"""Events as the dense arrays that networks take: voxel grids, counts and time surfaces."""

from sensor.representations.images import event_counts, time_surface
from sensor.representations.voxel_grid import voxel_grid

__all__ = ["event_counts", "time_surface", "voxel_grid"]
