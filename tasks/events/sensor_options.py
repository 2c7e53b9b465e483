"""Options of `eres simulate` for a sensor's pixels and bus."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sensor.cameras import EventCamera, camera_names, find_camera
from sensor.errors import SensorError, nearest
from sensor.model import Photoreceptor, SensorModel
from sensor.profiles import Profile, find_profile
from tasks.errors import TaskError

if TYPE_CHECKING:
    from sensor import Readout


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelOptions:
    """Properties of real pixels; all are off by default.

    Sources are in the docstring of `sensor.SensorModel`.

    Parameters
    ----------
    profile
        Electronics of a real sensor: a name (`eres sensors` lists them) or a TOML file. Other
        options override it.
    photoreceptor
        two_pole, one_pole, or v2e: v2e's limit for small steps, one pole whose cutoff depends on
        each pixel's light; two_pole by default. The other two need a cutoff.
    threshold_off
        Contrast threshold of OFF events, log units; by default that of ON events.
    cutoff
        Corner frequency of each of the photoreceptor's poles, Hz; by default an ideal pixel. The
        paper uses 200 Hz for day and 50 Hz for night.
    illuminance
        Light on the scene, lux; it sets the cutoff, 3 Hz per lux or as the profile says, and the
        profile's shot noise.
    cutoff_follows_light
        Make the cutoff proportional to each pixel's own light; white has the given cutoff.
    random_start
        Start the memory of each pixel at a random level, as in a sensor that has been running.
    fill_factor
        Share of a pixel's area that is sensitive to light, 0 to 1; by default that of the camera,
        or 1.
    threshold_mismatch
        Standard deviation of the contrast threshold between pixels, log units; typically 0.03.
    leak
        Rate of ON events of a pixel in constant light, Hz; typically 0.1.
    shot_noise
        Rate of noise events of a pixel in the dark, Hz.
    shot_noise_exponent
        The rate of noise events falls as (1 + light / dark level) to the power of minus this; 0.5
        by default.
    hot_pixels
        Share of pixels that are hot, 0 to 1.
    hot_pixel_rate
        Rate of noise events of a hot pixel in any light, Hz; 100 by default.
    refractory
        Time after an event in which a pixel fires no other, seconds.
    latency
        Delay of every event after its cause, in addition to that of the photoreceptor, seconds.
    """

    profile: str | None = None
    photoreceptor: Photoreceptor | None = None
    threshold_off: float | None = None
    cutoff: float | None = None
    illuminance: float | None = None
    cutoff_follows_light: bool = False
    random_start: bool = False
    fill_factor: float | None = None
    threshold_mismatch: float | None = None
    leak: float | None = None
    shot_noise: float | None = None
    shot_noise_exponent: float | None = None
    hot_pixels: float | None = None
    hot_pixel_rate: float | None = None
    refractory: float | None = None
    latency: float | None = None

    def applied_to(self, model: SensorModel, white_level: float) -> SensorModel:
        """Return a sensor with these pixels.

        Parameters
        ----------
        model
            The sensor.
        white_level
            Radiance of white.

        Returns
        -------
        The sensor with these pixels.

        Raises
        ------
        TaskError
            Options exclude each other, or one needs another.
        SensorError
            A value is outside its range.
        """
        if self.illuminance is not None and self.cutoff is not None:
            raise TaskError(
                "found both cutoff and illuminance, expected at most one of them: leave out "
                "--cutoff or --illuminance"
            )
        profile = NO_PROFILE if self.profile is None else find_profile(self.profile)
        model = profile.applied_to(model, self.illuminance, self.shot_noise_exponent)
        given = {
            field: getattr(self, name)
            for name, field in _FIELDS.items()
            if getattr(self, name) is not None
        }
        model = replace(model, cutoff_reference=None, random_start=self.random_start, **given)
        for name, of in _PARTS_OF_NOISE:
            alone = getattr(self, name) is not None and getattr(self, of) is None
            if alone and not getattr(model, _FIELDS[of]):
                said, needed = (one.replace("_", "-") for one in (name, of))
                raise TaskError(f"{said}: found it without --{needed}, expected both, or a profile")
        limited = model.cutoff_hz < math.inf
        if not limited and self.cutoff is None and self.illuminance is None:
            self.refuse_photoreceptor("--cutoff or --illuminance, such as --cutoff 200")
        if self.cutoff_follows_light:
            if not limited:
                raise TaskError(
                    "cutoff-follows-light: found no cutoff, expected --cutoff or --illuminance, "
                    "such as --cutoff 200"
                )
            if model.photoreceptor == "v2e":
                raise TaskError(
                    "cutoff-follows-light: found it with the photoreceptor v2e, whose cutoff "
                    "follows the light in its own way; leave it out"
                )
        if limited and (self.cutoff_follows_light or model.photoreceptor == "v2e"):
            model = replace(model, cutoff_reference=white_level)
        return model

    def at_cutoff(self, cutoff_hz: float) -> PixelOptions:
        """Return the options with a cutoff; inf does not follow the light.

        Parameters
        ----------
        cutoff_hz
            Corner frequency of the photoreceptor, Hz.

        Returns
        -------
        The options.
        """
        follows = self.cutoff_follows_light and cutoff_hz < math.inf
        return replace(self, cutoff=cutoff_hz, cutoff_follows_light=follows)

    def refuse_photoreceptor(self, expected: str) -> None:
        """Refuse a photoreceptor that is given by hand for pixels without a cutoff.

        Parameters
        ----------
        expected
            What would give a cutoff.

        Raises
        ------
        TaskError
            It is one_pole or v2e, of which ideal pixels have nothing.
        """
        if self.photoreceptor in ("one_pole", "v2e"):
            raise TaskError(
                f"photoreceptor: found {self.photoreceptor} without a cutoff, expected {expected}"
            )

    def settled(self) -> PixelOptions:
        """Return the same pixels without a profile, with all values except the cutoff explicit."""
        plain = SensorModel(width=1, height=1, dark_level=1.0)
        same = replace(self, cutoff=float("inf"), illuminance=None, cutoff_follows_light=False)
        model = same.applied_to(plain, 1.0)
        values = {name: getattr(model, field) for name, field in _FIELDS.items()}
        return replace(self, **{**values, "profile": None, "cutoff": self.cutoff})


# Options and the fields of `SensorModel` that they set.
_FIELDS = {
    "photoreceptor": "photoreceptor",
    "threshold_off": "contrast_threshold_off",
    "cutoff": "cutoff_hz",
    "fill_factor": "fill_factor",
    "threshold_mismatch": "threshold_mismatch",
    "leak": "leak_hz",
    "shot_noise": "shot_noise_hz",
    "shot_noise_exponent": "shot_noise_exponent",
    "hot_pixels": "hot_pixel_fraction",
    "hot_pixel_rate": "hot_pixel_hz",
    "refractory": "refractory_s",
    "latency": "latency_s",
}

# Options that have no effect without another.
_PARTS_OF_NOISE = (("shot_noise_exponent", "shot_noise"), ("hot_pixel_rate", "hot_pixels"))

IDEAL_PIXEL = PixelOptions()
NO_PROFILE = Profile("none", "ideal pixels", {})


@dataclass(frozen=True, slots=True, kw_only=True)
class BusOptions:
    """The bus on which events leave the sensor, see `sensor.Readout`.

    Parameters
    ----------
    bus
        Capacity of the bus, million events per second; or the name of a camera with such a bus, as
        in `eres sensors`; or unlimited, for events that leave at once. By default that of the
        camera, or unlimited.
    fifo
        Number of events that can wait for the bus; an event that finds the queue full is dropped.
    row_overhead
        Time to open a row of pixels, seconds. The row that has waited longest is read next.
    """

    bus: str | None = None
    fifo: int = 4096
    row_overhead: float = 0.0

    def readout(self, sensor: str | None = None) -> Readout | None:
        """Return the bus, None if it is unlimited.

        Parameters
        ----------
        sensor
            Name of the camera whose bus is the default; its bandwidth may be unknown.

        Returns
        -------
        The bus.

        Raises
        ------
        TaskError
            The bus is neither a rate nor a camera with a known bandwidth.
        SensorError
            A value is outside its range.
        """
        rate_hz = self._rate_hz(sensor)
        if rate_hz is None:
            if (self.fifo, self.row_overhead) != (NO_BUS.fifo, NO_BUS.row_overhead):
                raise TaskError("fifo, row-overhead: found no bus, expected one, such as --bus 12")
            return None
        from sensor import Readout  # here, as Numba would slow down `--help`

        return Readout(max_rate_hz=rate_hz, fifo_depth=self.fifo, row_overhead_s=self.row_overhead)

    def _rate_hz(self, sensor: str | None) -> float | None:
        if self.bus is None:
            return None if sensor is None else _known(find_grid(sensor).bus_hz)
        if self.bus == UNLIMITED:
            return None
        try:
            return float(self.bus) * 1e6
        except ValueError:
            names = grid_names()
            if self.bus not in names:
                raise TaskError(
                    f"bus: found {self.bus!r}, neither a rate in million events per second, "
                    f"such as --bus 12, nor {UNLIMITED}, nor a camera; {nearest(self.bus, names)}"
                ) from None
        rate_hz = _known(find_grid(self.bus).bus_hz)
        if rate_hz is None:
            raise TaskError(
                f"bus: the bandwidth of {self.bus!r} is unknown, expected a rate in million events "
                "per second, such as --bus 12, or another camera"
            )
        return rate_hz


def _known(rate_hz: float) -> float | None:
    return rate_hz if rate_hz < math.inf else None


def grid_names() -> list[str]:
    """Return the names of the cameras of the catalogue that have a grid."""
    return [name for name in camera_names() if find_camera(name).width is not None]


def find_grid(name: str) -> EventCamera:
    """Return a camera of the catalogue with its grid and bus, and with ideal electronics."""
    names = grid_names()
    if name not in names:
        raise SensorError(f"sensor: found {name!r}; {nearest(name, names)}")
    return find_camera(name).with_electronics(EventCamera())


UNLIMITED = "unlimited"
NO_BUS = BusOptions()
