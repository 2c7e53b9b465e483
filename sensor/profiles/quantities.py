"""What a profile can say: its fields, their units, and where they go in a `SensorModel`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sensor.cameras.fields import ALIASES, KEYS, Convert
from sensor.cameras.fields import FIELDS as FIELDS_OF_CAMERA


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that a profile can have.

    Parameters
    ----------
    units
        Its possible units, with the conversion to the model's unit, which is first.
    field
        Its field of `SensorModel`, None if it has none.
    """

    units: Mapping[str, Convert]
    field: str | None


_NAMES = (
    *("threshold_on", "threshold_off", "threshold_mismatch", "cutoff", "illuminance", "leak"),
    *("shot_noise", "shot_noise_exponent", "hot_pixels", "hot_pixel_rate", "refractory", "latency"),
)
QUANTITIES: dict[str, Quantity] = {
    name: Quantity(
        KEYS[ALIASES.get(name, name)].units,
        None if name == "illuminance" else FIELDS_OF_CAMERA[ALIASES.get(name, name)],
    )
    for name in _NAMES
}
FIELDS = ("photoreceptor", *QUANTITIES)
"""All fields of a profile."""
