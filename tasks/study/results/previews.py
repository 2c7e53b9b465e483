"""The content of `previews/index.json` of a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from eres_render.storage.settings_reader import FloatOrInf


@dataclass(frozen=True, slots=True, kw_only=True)
class Preview:
    """One picture: the radiance of a scene, or the events of one sensor.

    Parameters
    ----------
    file
        Name of the PNG file in the same folder.
    scene, speed, width, cutoff_hz
        The scene, the factor on the base speed, and the sensor (px, Hz).
    """

    file: str
    scene: str
    speed: float
    kind: Literal["frame", "events"]
    width: int
    cutoff_hz: FloatOrInf
    caption: str
