"""Names of the variants of tasks, as rows have them; the usual variant has the name ""."""

from __future__ import annotations

import re

NATIVE_PATCH = "61 px patch"
"""Flow of patches of 61 px of the sensor, whatever its width."""


def equalization_variant(name: str) -> str:
    """Return the variant of video whose images are compared with another equalization."""
    return f"equalization {name}"


def sigma_variant(sigma_mm: float) -> str:
    """Return the variant of tracking whose start is off by a standard deviation, mm."""
    return f"sigma {sigma_mm:g} mm"


def sigma_mm(variant: str) -> float | None:
    """Return the standard deviation in mm of a variant such as "sigma 2 mm"; None for others."""
    match = re.fullmatch(r"sigma ([0-9.e+-]+) mm", variant)
    return float(match[1]) if match else None
