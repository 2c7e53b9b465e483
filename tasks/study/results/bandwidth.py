"""Compare event rates with the bus bandwidth of real cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sensor.presets import SENSORS, SensorPreset


@dataclass(frozen=True, slots=True)
class Load:
    """Load on the bus of a real camera.

    Attributes
    ----------
    camera
        Camera with the width of the simulated sensor.
    rate_hz, capacity_hz
        Event rate of its pixels and capacity of its bus, events/s.
    """

    camera: SensorPreset
    rate_hz: float
    capacity_hz: float

    @property
    def share(self) -> float:
        """Return the load as a share of the capacity; above 1 the bus saturates."""
        return self.rate_hz / self.capacity_hz

    @property
    def survives(self) -> bool:
        """Return whether the bus carries the mean rate."""
        return self.share <= 1


def bus_loads(
    rates_hz: Mapping[int, float], cameras: Mapping[str, SensorPreset] = SENSORS
) -> list[Load]:
    """Compare simulated event rates with the buses of real cameras of the same widths.

    Parameters
    ----------
    rates_hz
        Event rates of square sensors, events/s, by width in px.
    cameras
        Real cameras; those without a stated bandwidth are skipped.

    Returns
    -------
    list of Load
        One load per camera of a given width, by width and bandwidth. The rate of the square sensor
        is scaled by the camera's height over its width.
    """
    loads = [
        Load(camera, rates_hz[size.width] * size.height / size.width, bandwidth * 1e6)
        for camera in cameras.values()
        if (size := camera.model).width in rates_hz
        and (bandwidth := camera.max_bandwidth_mev_s) is not None
    ]
    return sorted(loads, key=lambda load: (load.camera.model.width, load.capacity_hz))


def capacities_hz(cameras: Mapping[str, SensorPreset] = SENSORS) -> list[float]:
    """Return the distinct bus capacities of real cameras, events/s, ascending."""
    stated = {c.max_bandwidth_mev_s for c in cameras.values()} - {None}
    return sorted(1e6 * bandwidth for bandwidth in stated if bandwidth is not None)


def usual_bus_hz(width: int, cameras: Mapping[str, SensorPreset] = SENSORS) -> float:
    """Return the capacity of the fastest bus of real cameras up to a width, events/s.

    Parameters
    ----------
    width
        Width of the finest sensor of a study, px.
    cameras
        Real cameras; those without a stated bandwidth are skipped.

    Returns
    -------
    float
        Capacity; that of the slowest bus if all cameras are wider.
    """
    coarse = {name: one for name, one in cameras.items() if one.model.width <= width}
    return max(capacities_hz(coarse), default=min(capacities_hz(cameras)))
