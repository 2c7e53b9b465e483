"""The cameras of a study: plain ones of its widths, those of its file, and their lights."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from eres_render.storage.settings_reader import read_typed
from sensor.cameras import EventCamera, find_camera
from sensor.cameras.files import camera_of
from sensor.errors import SensorError
from sensor.model import SensorModel, cutoff_in_light
from tasks.errors import StudyError


class StudyLight(NamedTuple):
    """Light on the scene: the cutoff of plain sensors in Hz, and the illuminance in lux or 0."""

    cutoff_hz: float
    illuminance_lux: float = 0.0

    def on(self, camera: EventCamera, white: float = 1.0) -> SensorModel:
        """Return the pixels of a camera in this light."""
        if self.illuminance_lux:
            return camera.model(lux=self.illuminance_lux, white=white)
        return camera.model(cutoff_hz=self.cutoff_hz, white=white)


def light_at(illuminance_lux: float) -> StudyLight:
    """Return the light of an illuminance in lux; inf is light for ideal pixels."""
    if math.isinf(illuminance_lux):
        return StudyLight(math.inf)
    return StudyLight(cutoff_in_light(illuminance_lux), illuminance_lux)


def own_of(camera: EventCamera) -> tuple[str, ...]:
    """Return the settings of a study that a camera overrides with a value of its own."""
    own = {
        "contrast_thresholds": camera.states("threshold") or camera.states("threshold_off"),
        "photoreceptors": camera.states("photoreceptor") or camera.cutoff_follows_light,
        "bus": camera.states("bus") and camera.bus is None,
    }
    return tuple(name for name, holds in own.items() if holds)


AREA = "area^"
"""Before the exponent in the name of a camera with an exponent of `area_exponents`."""


def read_camera_of(entry: Any, where: str, folder: Path) -> EventCamera:
    """Read a camera from an entry of `simulate.sensors`.

    Parameters
    ----------
    entry
        The name of a camera, a TOML file, or a table with the keys of such a file and `name`.
    """
    try:
        if isinstance(entry, str):
            camera = find_camera(folder / entry if entry.endswith(".toml") else entry)
        elif isinstance(entry, dict):
            table = dict(entry)
            name = read_typed(str, table.pop("name", ""), Path(where), StudyError, "name")
            camera = camera_of(table, name, folder)
        else:
            raise StudyError(f"{where}: found {entry!r}, expected a name, a .toml file or a table")
        width, height = camera.size
    except SensorError as error:
        raise StudyError(f"{where}: {error}") from None
    return camera if camera.name else replace(camera, name=f"{width}x{height}")
