"""The buses of real cameras."""

from __future__ import annotations

import math

from sensor.cameras import camera_names, find_camera


def capacities_hz(widest: float = math.inf) -> list[float]:
    """Return the distinct bus capacities of cameras up to a width, events/s, ascending."""
    cameras = map(find_camera, camera_names())
    narrow = [camera for camera in cameras if camera.width is not None and camera.width <= widest]
    return sorted({camera.bus_hz for camera in narrow} - {math.inf})


def usual_bus_hz(width: int) -> float:
    """Return the capacity of the fastest bus of real cameras up to a width, events/s.

    Parameters
    ----------
    width
        Width of the finest sensor of a study, px.
    """
    return max(capacities_hz(width), default=min(capacities_hz()))
