"""A sensor before a sequence: what scorers watch."""

from __future__ import annotations

from dataclasses import dataclass

from sensor import SensorModel


@dataclass(frozen=True, slots=True)
class Setting:
    """A sensor, how much faster than rendered things move before it, and its window.

    The window is half-open, in the time of the sensor's events.
    """

    model: SensorModel
    speed: float
    start_us: int
    end_us: int

    @property
    def seconds(self) -> float:
        """Length of the window."""
        return (self.end_us - self.start_us) * 1e-6
