"""What a run's `previews/index.json` says of its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from eres_render.storage.settings_reader import FloatOrInf


@dataclass(frozen=True, slots=True, kw_only=True)
class Preview:
    """One picture: the radiance of a scene, or what one sensor saw of it.

    Parameters
    ----------
    file
        Name of the PNG file in the same folder.
    scene, speed, width, cutoff_hz
        Where it was taken, and by which sensor.
    """

    file: str
    scene: str
    speed: float
    kind: Literal["frame", "events"]
    width: int
    cutoff_hz: FloatOrInf
    caption: str
