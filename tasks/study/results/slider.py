"""The virtual slider: prints from three distances at three speeds, as in the paper's real data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sensor import cutoff_in_light
from tasks.study.results.paper_slider import SIZES_PX

PRINTS = tuple(SIZES_PX)
"""Names of the scenes; the paper's prints show the same subjects."""

FIELD_PX = SIZES_PX["forest"]
"""Size of the field of view of every print, by distance from the farthest on, px."""

NEAREST_M = 0.236
"""Distance of the camera at the full size; the others follow from the widths."""

BASE_SPEED_M_PER_S = 0.2
"""Speed of the slider at factor 1."""


def is_of_slider(config: Mapping[str, Any]) -> bool:
    """Return whether a study, the content of study.json, is on the virtual slider.

    The distances, and what the paper measured, are those of cameras of one lens, whose full size is
    the slider's, and which lose no events.
    """
    render, simulate = config.get("render", {}), config.get("simulate", {})
    return (
        bool(simulate.get("same_lens"))
        and simulate.get("bus_mev_s") is None
        and render.get("resolution") == FIELD_PX[-1][0]
    )


def distance_label(width: int) -> str:
    """Name the distance from which the field is `width` px wide."""
    return f"{100 * NEAREST_M * FIELD_PX[-1][0] / width:.1f} cm"


def light_label(cutoff_hz: float) -> str:
    """Name the light that gives a pixel this cutoff, see `sensor.cutoff_in_light`."""
    if math.isinf(cutoff_hz):
        return "ideal"
    return f"{cutoff_hz / cutoff_in_light(1.0):.3g} lux"
