"""Options of `eres simulate` for a sensor's pixels and bus."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sensor.model import SensorModel, cutoff_in_light
from sensor.presets import SENSORS, hint
from tasks.errors import TaskError

if TYPE_CHECKING:
    from sensor import Readout


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelOptions:
    """Properties of real pixels; all are off by default.

    Sources are in the docstring of `sensor.SensorModel`.

    Parameters
    ----------
    cutoff
        Corner frequency of each of the photoreceptor's poles, Hz; by default an ideal pixel. The
        paper uses 200 Hz for day and 50 Hz for night.
    illuminance
        Light on the scene, lux; it sets the cutoff, 3 Hz per lux.
    cutoff_follows_light
        Make the cutoff proportional to each pixel's own light; white has the given cutoff.
    poles
        Poles of the photoreceptor, 1 or 2.
    random_start
        Start pixels at random phases, as in a sensor that has been running.
    fill_factor
        Share of a pixel's area that sees light, 0 to 1.
    threshold_mismatch
        Standard deviation of the contrast threshold between pixels, log units; typically 0.03.
    leak
        Rate of ON events of a pixel in constant light, Hz; typically 0.1.
    shot_noise
        Rate of noise events of a pixel in the dark, Hz.
    shot_noise_exponent
        Their rate falls as (1 + light / dark level) to the power of minus this.
    hot_pixels
        Share of pixels that are hot, 0 to 1.
    hot_pixel_rate
        Rate of noise events of a hot pixel in any light, Hz.
    refractory
        Time after an event in which a pixel reports no other, seconds.
    """

    cutoff: float | None = None
    illuminance: float | None = None
    cutoff_follows_light: bool = False
    poles: int = 2
    random_start: bool = False
    fill_factor: float = 1.0
    threshold_mismatch: float = 0.0
    leak: float = 0.0
    shot_noise: float = 0.0
    shot_noise_exponent: float = 0.5
    hot_pixels: float = 0.0
    hot_pixel_rate: float = 100.0
    refractory: float = 0.0

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
        cutoff_hz = model.cutoff_hz if self.cutoff is None else self.cutoff
        if self.illuminance is not None:
            if self.cutoff is not None:
                raise TaskError(
                    "found both cutoff and illuminance, expected at most one of them: leave out "
                    "--cutoff or --illuminance"
                )
            cutoff_hz = cutoff_in_light(self.illuminance)
        if self.cutoff_follows_light and cutoff_hz == float("inf"):
            raise TaskError(
                "cutoff-follows-light: found no cutoff, expected --cutoff or --illuminance, such "
                "as --cutoff 200"
            )
        return replace(
            model,
            cutoff_hz=cutoff_hz,
            cutoff_reference=white_level if self.cutoff_follows_light else None,
            poles=self.poles,
            random_start=self.random_start,
            fill_factor=self.fill_factor,
            threshold_mismatch=self.threshold_mismatch,
            leak_hz=self.leak,
            shot_noise_hz=self.shot_noise,
            shot_noise_exponent=self.shot_noise_exponent,
            hot_pixel_fraction=self.hot_pixels,
            hot_pixel_hz=self.hot_pixel_rate,
            refractory_s=self.refractory,
        )


IDEAL_PIXEL = PixelOptions()


@dataclass(frozen=True, slots=True, kw_only=True)
class BusOptions:
    """The bus on which events leave the sensor, see `sensor.Readout`; by default all leave at once.

    Parameters
    ----------
    bus
        Capacity of the bus, million events per second, or the name of a camera with such a bus, see
        `eres sensors`.
    fifo
        Number of events that can wait for the bus; an event that finds the queue full is dropped.
    row_overhead
        Time to open a row of pixels, seconds. The row that has waited longest is next.
    """

    bus: str | None = None
    fifo: int = 4096
    row_overhead: float = 0.0

    def readout(self) -> Readout | None:
        """Return the bus, None if there is none.

        Raises
        ------
        TaskError
            The bus is neither a rate nor a camera with a known bandwidth.
        SensorError
            A value is outside its range.
        """
        if self.bus is None:
            if self != NO_BUS:
                raise TaskError("fifo, row-overhead: found no bus, expected one, such as --bus 12")
            return None
        rate_mev_s: float | None
        try:
            rate_mev_s = float(self.bus)
        except ValueError:
            if self.bus not in SENSORS:
                raise TaskError(
                    f"bus: found {self.bus!r}, neither a rate in million events per second, "
                    f"such as --bus 12, nor a camera; {hint(self.bus)}"
                ) from None
            rate_mev_s = SENSORS[self.bus].max_bandwidth_mev_s
        if rate_mev_s is None:
            raise TaskError(
                f"bus: the bandwidth of {self.bus!r} is unknown, expected a rate in million events "
                "per second, such as --bus 12, or another camera"
            )
        from sensor import Readout  # here, as Numba loads more slowly than help prints

        return Readout(
            max_rate_hz=rate_mev_s * 1e6, fifo_depth=self.fifo, row_overhead_s=self.row_overhead
        )


NO_BUS = BusOptions()
