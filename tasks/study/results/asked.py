"""Sensors, lights and speeds as a study gives them, by which conditions are sorted and named.

A light in lux is its cutoff in Hz, and sorts among cutoffs. A speed in m/s equals no factor on the
base speed, so it matches no condition of the paper, whose speeds are factors.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from sensor.model import cutoff_in_light
from tasks.row import Row


class SensorId(NamedTuple):
    """What tells a sensor of a study from the others; its text is its name, or else its width."""

    width: int  # px
    name: str = ""  # "" for a plain sensor

    def __str__(self) -> str:
        return self.name or str(self.width)

    @property
    def label(self) -> str:
        """Name of the sensor, or its width with the unit."""
        return self.name or f"{self.width} px"


class OfSensor(Protocol):
    """What has the width of a sensor, px, and its name."""

    @property
    def width(self) -> int: ...

    @property
    def sensor(self) -> str: ...


class InLight(Protocol):
    """What has a cutoff, and an illuminance, 0 if the study does not give lux."""

    @property
    def cutoff_hz(self) -> float: ...

    @property
    def illuminance_lux(self) -> float: ...


class CutoffInLux(float):
    """The photoreceptor cutoff, Hz, of a light that is given in lux."""

    illuminance_lux: float

    def __new__(cls, illuminance_lux: float) -> CutoffInLux:
        cutoff_hz = super().__new__(cls, cutoff_in_light(illuminance_lux))
        cutoff_hz.illuminance_lux = illuminance_lux
        return cutoff_hz


class MetersPerSecond(float):
    """The mean speed of the camera, m/s, in place of a factor on its base speed."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MetersPerSecond) and float(self) == float(other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash((MetersPerSecond, float(self)))


def sensor_of(each: OfSensor) -> SensorId:
    """Return the sensor of a row, a condition, a picture or a histogram."""
    return SensorId(each.width, each.sensor)


def light_of(each: InLight) -> float:
    """Return the light of a row or a setting: its cutoff, as `CutoffInLux` if there is lux."""
    return CutoffInLux(each.illuminance_lux) if each.illuminance_lux else each.cutoff_hz


def lux_of(light: float) -> float:
    """Return the illuminance of a light, 0 if it is not `CutoffInLux`."""
    return light.illuminance_lux if isinstance(light, CutoffInLux) else 0.0


def speed_of(row: Row) -> float:
    """Return the speed of a row: the factor on the base speed, or m/s if the study gives m/s."""
    return MetersPerSecond(row.speed_m_s) if row.speed_m_s else row.speed
