"""What random crops look like."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Literal

from eres_render.errors import check_positive
from sensor import EventCamera, find_camera
from tasks.errors import TaskError

MAX_SIDE_PX = 1024
"""Largest side of a crop."""

CropLight = Literal["ideal", "all"]
"""Whether pixels are ideal in all crops ("ideal"), or each crop draws its cutoff ("all")."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crops:
    """Ranges from which each crop draws its properties, uniformly on a logarithmic scale.

    `motion_px` is the mean motion in the image, px per window. `log_contrast` is the standard
    deviation of a texture's log intensity. `texels_per_px` counts texels of a 512 x 512 texture
    along a pixel; with more than 2 the texture is aliased. `max_displacement_px` is the largest
    motion between two frames. `ideal_share` is the share of the crops that have ideal pixels with
    light "all". `sensor` is the name or TOML file of a camera, for what crops do not draw:
    photoreceptor, dark level, noise and delays, without its bus. Its OFF threshold keeps its ratio
    to the ON threshold.
    """

    side_px: int = 80
    window_ms: float = 25.0
    motion_px: tuple[float, float] = (1.0, 30.0)
    cutoff_hz: tuple[float, float] = (25.0, 400.0)
    ideal_share: float = 0.4
    contrast_threshold: tuple[float, float] = (0.15, 0.25)
    log_contrast: tuple[float, float] = (0.25, 1.1)
    texels_per_px: tuple[float, float] = (0.25, 2.0)
    max_displacement_px: float = 1.0
    sensor: str = ""

    @property
    def camera(self) -> EventCamera:
        """The camera, with the side of a crop."""
        camera = find_camera(self.sensor) if self.sensor else EventCamera()
        return camera.on(self.side_px, self.side_px)

    def __post_init__(self) -> None:
        for name, low, high in (("side_px", 16, MAX_SIDE_PX), ("ideal_share", 0, 1)):
            if not low <= getattr(self, name) <= high:
                raise TaskError(f"{name}: found {getattr(self, name)}, expected {low} to {high}")
        for name in ("window_ms", "max_displacement_px"):
            check_positive(name, getattr(self, name), TaskError)
        _ = self.camera
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple) and not 0 < value[0] <= value[1] < math.inf:
                raise TaskError(
                    f"{field.name}: found {list(value)}, expected two positive, ascending numbers"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class FlowCrops(Crops):
    """As `Crops`, with the defaults for flow: larger crops, and windows as long as the study's."""

    side_px: int = 128
    window_ms: float = 50.0
    motion_px: tuple[float, float] = (1.0, 40.0)
    texels_per_px: tuple[float, float] = (0.5, 2.0)
