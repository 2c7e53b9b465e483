"""`Profile`: the electronics of a sensor, each value with its source."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from sensor.model import SensorModel, cutoff_in_light
from sensor.profiles.quantities import FIELDS, QUANTITIES


@dataclass(frozen=True, slots=True)
class Sourced:
    """A value, and where it comes from.

    Parameters
    ----------
    value
        In the unit of `SensorModel`: log units, Hz, seconds, lux; or a photoreceptor's name.
    source
        A publication, a file, or how it was measured.
    interval
        (2,) its 95 % interval in the same unit, None if it is unknown.
    """

    value: float | str
    source: str
    interval: tuple[float, float] | None = None


class Bound(NamedTuple):
    """The interval of a value that is not known: it is never simulated.

    Parameters
    ----------
    interval
        (2,) its ends in the unit of `SensorModel`; one that is 0 or inf is open.
    source
        As of `Sourced`.
    """

    interval: tuple[float, float]
    source: str


@dataclass(frozen=True, slots=True)
class Profile:
    """The electronics of a sensor.

    Parameters
    ----------
    name
        Its name, or its file.
    title
        Which sensor it describes.
    known
        The known values by field.
    bounds
        The intervals of other fields.

    Examples
    --------
    >>> from sensor.profiles import find_profile
    >>> profile = find_profile("dvs128")
    >>> profile.known["cutoff"].value, profile.known["illuminance"].value
    (3000.0, 1000.0)
    >>> profile.unknown
    ('photoreceptor', 'shot_noise', 'shot_noise_exponent', 'hot_pixels', ...)
    """

    name: str
    title: str
    known: Mapping[str, Sourced]
    bounds: Mapping[str, Bound] = field(default_factory=dict)

    @property
    def unknown(self) -> tuple[str, ...]:
        """Fields without a value; a sensor keeps its own there."""
        return tuple(name for name in FIELDS if name not in self.known)

    def number(self, name: str) -> float | None:
        """Return a number in the unit of `SensorModel`, None if it is unknown."""
        found = self.known.get(name)
        return None if found is None or isinstance(found.value, str) else found.value

    def applied_to(
        self,
        model: SensorModel,
        illuminance_lux: float | None = None,
        shot_noise_exponent: float | None = None,
    ) -> SensorModel:
        """Return a sensor with these electronics.

        Light decides cutoff and shot noise together. The cutoff is proportional to it
        (Lichtsteiner, Posch and Delbruck 2008): from the profile's own pair of cutoff and
        illuminance if it has both, else 3 Hz per lux. The rate of shot noise falls with the light
        to the power of `shot_noise_exponent`, which is also its fall from dark to bright pixels of
        one scene; in v2e too less light means more noise (Hu, Liu and Delbruck 2021).

        Parameters
        ----------
        model
            The sensor; it keeps its values of the fields that the profile does not give.
        illuminance_lux
            Light on the scene; None for that of the profile.
        shot_noise_exponent
            In place of the profile's; None for that.

        Returns
        -------
        SensorModel

        Raises
        ------
        SensorError
            The illuminance is not a positive number, or a value is outside its range.

        Examples
        --------
        A tenth of the light gives a tenth of the cutoff:

        >>> from sensor import SensorModel
        >>> from sensor.profiles import find_profile
        >>> dim = find_profile("dvs128").applied_to(SensorModel(width=128, height=128), 100.0)
        >>> dim.cutoff_hz
        300.0
        """
        changes: dict[str, Any] = {
            quantity.field: self.known[name].value
            for name, quantity in QUANTITIES.items()
            if name in self.known and quantity.field is not None
        }
        if shot_noise_exponent is not None:
            changes["shot_noise_exponent"] = shot_noise_exponent
        if "photoreceptor" in self.known:
            changes["photoreceptor"] = self.known["photoreceptor"].value
        if illuminance_lux is not None:
            exponent = changes.get("shot_noise_exponent", model.shot_noise_exponent)
            changes |= self._in_light(illuminance_lux, exponent)
        if changes.get("cutoff_hz") == math.inf:
            changes["cutoff_reference"] = None
        return replace(model, **changes)

    def _in_light(self, illuminance_lux: float, exponent: float) -> dict[str, float]:
        """Return the fields that depend on the light."""
        usual_hz = cutoff_in_light(illuminance_lux)
        cutoff_hz, lux, noise_hz = map(self.number, ("cutoff", "illuminance", "shot_noise"))
        limited = cutoff_hz is not None and cutoff_hz < math.inf
        times: float | None = None  # light relative to that of the profile
        if lux is not None:
            times = illuminance_lux / lux
            changes = {"cutoff_hz": cutoff_hz * times if limited and cutoff_hz else usual_hz}
        else:
            times = usual_hz / cutoff_hz if limited and cutoff_hz else None
            changes = {"cutoff_hz": usual_hz}
        if noise_hz is not None and times is not None:
            try:
                changes["shot_noise_hz"] = noise_hz * times**-exponent
            except (OverflowError, ZeroDivisionError):
                changes["shot_noise_hz"] = math.inf  # which SensorModel refuses
        return changes
