"""The content of `previews/index.json` of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from eres_render.storage.settings_reader import FloatOrInf

INDEX_NAME = "index.json"
"""Name of the list of all pictures; those of one scene have its name."""

FILM_PICTURES = 8
FILM_S = 0.04
"""Pictures of a film, and the time that it shows at the end of the window, s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Preview:
    """A picture of the radiance of a scene, or of the events of a sensor.

    `file` is a PNG picture, or a WebP film of `FILM_PICTURES` square pictures side by side. Runs of
    older versions have no films. `speed` is a factor on the base speed. In lux, `cutoff_hz` is of
    plain sensors.
    """

    file: str
    scene: str
    speed: float
    kind: Literal["frame", "events"]
    width: int
    cutoff_hz: FloatOrInf
    caption: str
    illuminance_lux: float = 0.0
    sensor: str = ""

    @property
    def shows_film(self) -> bool:
        """Whether the file is a film."""
        return self.file.endswith(".webp")
