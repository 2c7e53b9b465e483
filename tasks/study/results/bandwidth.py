"""The buses of real cameras."""

from __future__ import annotations

from collections.abc import Mapping

from sensor.presets import SENSORS, SensorPreset


def capacities_hz(cameras: Mapping[str, SensorPreset] = SENSORS) -> list[float]:
    """Return the distinct bus capacities of real cameras, events/s, ascending."""
    stated = {c.max_bandwidth_mev_s for c in cameras.values()} - {None}
    return sorted(1e6 * bandwidth for bandwidth in stated if bandwidth is not None)


def usual_bus_hz(width: int) -> float:
    """Return the capacity of the fastest bus of real cameras up to a width, events/s.

    Parameters
    ----------
    width
        Width of the finest sensor of a study, px.

    Returns
    -------
    float
        Capacity; that of the slowest bus if all cameras are wider.
    """
    coarse = {name: one for name, one in SENSORS.items() if one.model.width <= width}
    return max(capacities_hz(coarse), default=min(capacities_hz()))
