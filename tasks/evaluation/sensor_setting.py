"""A sensor, the speed of the scene, and the scored window."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from sensor import Readout, SensorModel
from tasks.errors import TaskError

if TYPE_CHECKING:
    from sensor.emulators.v2e_steps import Version


class Emulation(NamedTuple):
    """v2e's program in place of exact pixels.

    Parameters
    ----------
    version
        As for `sensor.emulators.v2e`.
    every
        It sees every so many frames, counted from the start of the window; at its end it sees one.
    white
        Radiance that is 255 to it.
    name
        As `simulator` in `Row`.
    """

    version: Version
    every: int
    white: float
    name: str

    def of(self, model: SensorModel) -> SensorModel:
        """Return a sensor with v2e's pole, which follows the light."""
        reference = None if math.isinf(model.cutoff_hz) else self.white
        return replace(model, photoreceptor="v2e", cutoff_reference=reference)


@dataclass(frozen=True, slots=True)
class Setting:
    """A sensor, the speed of the scene, and the scored window.

    Parameters
    ----------
    model
        The sensor.
    speed
        Factor by which the scene moves faster than it was rendered.
    start_us, end_us
        The window [start_us, end_us), in the time of the sensor's events.
    name
        As `sensor` in `Row`.
    readout
        The bus on which the events leave; None if all leave when they fire.
    illuminance_lux, speed_m_s
        As in `Row`.
    distance
        Factor by which the camera is farther from the plane than in the frames; its focal length is
        longer by the same factor, so the image is the same, but the pose is not.
    scale
        Factor by which the scene and the camera's path are larger than in the frames; with the same
        camera, so the image is the same.
    t_start_s
        When the pixels start, s of the path: with the last frame at or before it, or else with the
        first of all.
    emulation
        What simulates the model's pixels; None for the exact engine.

    Raises
    ------
    TaskError
        The window is empty, as the speed is too high.
    """

    model: SensorModel
    speed: float
    start_us: int
    end_us: int
    name: str = ""
    readout: Readout | None = None
    illuminance_lux: float = 0.0
    speed_m_s: float = 0.0
    distance: float = 1.0
    scale: float = 1.0
    t_start_s: float = 0.0
    emulation: Emulation | None = None

    def __post_init__(self) -> None:
        if self.end_us <= self.start_us:
            raise TaskError(f"speed: {self.speed:g} makes a window shorter than 1 us; lower it")
