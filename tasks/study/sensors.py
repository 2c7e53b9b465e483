"""The cameras of a study: plain ones of its widths, those of its file, and their lights."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from eres_render.storage.settings_reader import read_typed
from sensor.cameras import EventCamera, find_camera
from sensor.cameras.files import camera_of
from sensor.errors import SensorError
from sensor.model import SensorModel, cutoff_in_light
from tasks.errors import StudyError

if TYPE_CHECKING:
    from sensor import Readout


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


def bus_of(camera: EventCamera, bus_mev_s: float | None) -> Readout | None:
    """Return the bus of a camera, or that of the study, in million events per second."""
    if bus_mev_s is None or camera.states("bus"):
        return camera.bus
    return replace(camera, bus_hz=1e6 * bus_mev_s).bus


def with_area_exponents(
    cameras: Iterable[EventCamera], exponents: Iterable[float]
) -> tuple[EventCamera, ...]:
    """Return cameras whose cutoff is lent once for each exponent of the area, the others as is."""
    powers = [*exponents]
    found: list[EventCamera] = []
    for one in cameras:
        if one.borrows_cutoff and one.area_um2 is not None:
            names = [(f"{one.name} {AREA}{power:g}", power) for power in powers]
            found += [replace(one, name=name, area_exponent=power) for name, power in names]
        else:
            found.append(one)
    return tuple(found)


AREA = "area^"
"""Before the exponent in the name of a camera of `with_area_exponents`."""


def read_camera_of(found: Any, where: str, folder: Path) -> EventCamera:
    """Read a camera from an entry of `simulate.sensors`.

    Parameters
    ----------
    found
        The name of a camera, a TOML file, or a table with the keys of such a file and `name`.
    """
    try:
        if isinstance(found, str):
            camera = find_camera(folder / found if found.endswith(".toml") else found)
        elif isinstance(found, dict):
            table = dict(found)
            name = read_typed(str, table.pop("name", ""), Path(where), StudyError, "name")
            camera = camera_of(table, name, folder)
        else:
            raise StudyError(f"{where}: found {found!r}, expected a camera, a file or a table")
        width, height = camera.size
    except SensorError as error:
        raise StudyError(f"{where}: {error}") from None
    return camera if camera.name else replace(camera, name=f"{width}x{height}")
