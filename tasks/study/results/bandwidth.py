"""Which resolution survives its own bus: event rates beside what real cameras carry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sensor.presets import SENSORS, SensorPreset


@dataclass(frozen=True, slots=True)
class Load:
    """What a real camera's bus would have to carry.

    Attributes
    ----------
    camera
        On the market; it has the width of the sensor that was simulated.
    rate_hz, capacity_hz
        Events a second that its pixels would fire, and the most that its bus carries.
    """

    camera: SensorPreset
    rate_hz: float
    capacity_hz: float

    @property
    def share(self) -> float:
        """Part of the bus that is used; above 1 it saturates."""
        return self.rate_hz / self.capacity_hz

    @property
    def survives(self) -> bool:
        """Whether the bus carries the mean rate."""
        return self.share <= 1


def bus_loads(
    rates_hz: Mapping[int, float], cameras: Mapping[str, SensorPreset] = SENSORS
) -> list[Load]:
    """Set simulated event rates beside the buses of real cameras of the same widths.

    Parameters
    ----------
    rates_hz
        Events a second of square sensors, by width in px.
    cameras
        Those without a stated bandwidth are left out.

    Returns
    -------
    A load for each camera of one of the widths, by width and bandwidth. A camera is less high than
    wide, so its rate is that of the square sensor times its height over its width.
    """
    loads = [
        Load(camera, rates_hz[size.width] * size.height / size.width, bandwidth * 1e6)
        for camera in cameras.values()
        if (size := camera.model).width in rates_hz
        and (bandwidth := camera.max_bandwidth_mev_s) is not None
    ]
    return sorted(loads, key=lambda load: (load.camera.model.width, load.capacity_hz))


def capacities_hz(cameras: Mapping[str, SensorPreset] = SENSORS) -> list[float]:
    """Most events a second that buses of real cameras carry, ascending, each once."""
    stated = {c.max_bandwidth_mev_s for c in cameras.values()} - {None}
    return sorted(1e6 * bandwidth for bandwidth in stated if bandwidth is not None)
