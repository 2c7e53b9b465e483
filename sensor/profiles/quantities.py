"""What a profile can say: its fields, their units, and where they go in a `SensorModel`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Convert = Callable[[float], float]


def _times(factor: float) -> Convert:
    return lambda value: factor * value


def _rise(percent: float) -> float:
    """Convert a contrast of brighter light to log units."""
    return math.log1p(percent / 100)


def _fall(percent: float) -> float:
    """Convert a contrast of darker light to log units."""
    return -math.log1p(-percent / 100) if percent < 100 else math.inf


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that a profile can have.

    Parameters
    ----------
    units
        Its possible units, with the conversion to the model's unit, which is first.
    field
        Its field of `SensorModel`, None if it has none.
    meaning
        Its meaning, in words.
    """

    units: Mapping[str, Convert]
    field: str | None
    meaning: str


_HZ = {"Hz": _times(1), "kHz": _times(1e3)}
_SECONDS = {"s": _times(1), "ms": _times(1e-3), "us": _times(1e-6)}
_SHARE = {"1": _times(1), "%": _times(1e-2)}

QUANTITIES: dict[str, Quantity] = {
    "threshold_on": Quantity(
        {"log": _times(1), "%": _rise}, "contrast_threshold", "contrast threshold of ON events"
    ),
    "threshold_off": Quantity(
        {"log": _times(1), "%": _fall}, "contrast_threshold_off", "contrast threshold of OFF events"
    ),
    "threshold_mismatch": Quantity(
        {"log": _times(1), "%": _times(1e-2)},
        "threshold_mismatch",
        "standard deviation of the thresholds between pixels",
    ),
    "cutoff": Quantity(_HZ, "cutoff_hz", "corner frequency of the photoreceptor"),
    "illuminance": Quantity(
        {"lux": _times(1), "klux": _times(1e3)}, None, "light for which cutoff and shot noise hold"
    ),
    "leak": Quantity(_HZ, "leak_hz", "ON events of a pixel in constant light"),
    "shot_noise": Quantity(_HZ, "shot_noise_hz", "noise events of a pixel in the dark"),
    "shot_noise_exponent": Quantity(
        {"1": _times(1)}, "shot_noise_exponent", "fall of the shot noise with the light"
    ),
    "hot_pixels": Quantity(_SHARE, "hot_pixel_fraction", "share of hot pixels"),
    "hot_pixel_rate": Quantity(_HZ, "hot_pixel_hz", "noise events of a hot pixel"),
    "refractory": Quantity(_SECONDS, "refractory_s", "dead time after an event"),
    "latency": Quantity(_SECONDS, "latency_s", "delay from the crossing to the event"),
}
FIELDS = ("photoreceptor", *QUANTITIES)
"""All fields of a profile."""
