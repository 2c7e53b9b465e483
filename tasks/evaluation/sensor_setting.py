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

    It sees every `every`th frame from the start of the window, and a frame at its end; `white` is
    the radiance that is 255 to it. `version` is as for `sensor.emulators.v2e`, `name` as
    `simulator` in `Row`.
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

    The window is [start_us, end_us) in the time of the sensor's events. The scene moves `speed`
    times as fast as it was rendered. The camera is `distance` times as far from the plane as in the
    frames, with a focal length longer by this factor: the same image, but another pose. The scene
    and the camera's path are `scale` times as large as in the frames, with the same camera and
    image. Pixels start at `t_start_s` of the path: with the last frame at or before it, or else
    with the first of all. `name` is as `sensor` in `Row`; `illuminance_lux` and `speed_m_s` are as
    in `Row`. Without a `readout`, all events leave when they fire; without an `emulation`, the
    exact engine simulates the pixels.
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
