"""What scores are sorted and named by: methods, and sensors, lights and speeds as a study gives
them.

A light in lux is its cutoff in Hz, and sorts among cutoffs. A speed in m/s equals no factor on the
base speed, so it matches no condition of the paper, whose speeds are factors.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from sensor.model import cutoff_in_light
from tasks.registry import TASKS, TaskSpec


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

    def at(self, scene: str, cutoff_hz: float, speed: float) -> Condition:
        """Return the condition of the sensor on a scene, in a light at a speed."""
        return Condition(scene, self.width, cutoff_hz, speed, self.name)


class OfSensor(Protocol):
    """What has the width of a sensor, px, and its name."""

    @property
    def width(self) -> int: ...

    @property
    def sensor(self) -> str: ...


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


class Condition(NamedTuple):
    """A scene and a sensor setting."""

    scene: str
    width: int  # px
    cutoff_hz: float  # `CutoffInLux` where the study asks in lux
    speed: float  # factor on the base speed; `MetersPerSecond` where the study asks in m/s
    sensor: str = ""  # its name; "" for a plain sensor


class Series(NamedTuple):
    """A method on a task with a metric. One table or one plot shows one series."""

    task: str
    method: str
    metric: str
    variant: str = ""  # variant of the task; "" is the usual one

    @property
    def spec(self) -> TaskSpec:
        """Its task: the metric, the methods and their labels."""
        return TASKS[self.task]

    @property
    def title(self) -> str:
        """Task, method and variant in words: "reconstruction by event integration"."""
        return f"{self.spec.title} by {self.name}"

    @property
    def name(self) -> str:
        """Method and variant in words."""
        method = self.spec.label(self.method)
        return f"{method}, {self.variant}" if self.variant else method

    @property
    def is_method(self) -> bool:
        """Whether this estimates from events: not a baseline, and nothing that gets the truth."""
        return self.spec.method(self.method).role == "method"


def sensor_of(each: OfSensor) -> SensorId:
    """Return the sensor of a row, a condition, a picture or a histogram."""
    return SensorId(each.width, each.sensor)


def light_of(cutoff_hz: float, illuminance_lux: float) -> float:
    """Return a light: its cutoff, as `CutoffInLux` if there is lux."""
    return CutoffInLux(illuminance_lux) if illuminance_lux else cutoff_hz


def lux_of(light: float) -> float:
    """Return the illuminance of a light, 0 if it is not `CutoffInLux`."""
    return light.illuminance_lux if isinstance(light, CutoffInLux) else 0.0
