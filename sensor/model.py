"""`SensorModel`: everything that decides which events a given light makes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sensor.numbers import real, refusal, whole

MAX_SIDE_PX = 1 << 16  # event coordinates are uint16
MAX_RATE_HZ = 1e6  # event times are whole microseconds
_CUTOFF_HZ_PER_LUX = 3.0


def cutoff_in_light(illuminance_lux: float) -> float:
    """Photoreceptor cutoff in Hz where a scene is lit with so many lux.

    Bandwidth is proportional to photocurrent; a DVS128 has 3 kHz in a scene lit with 1 klux
    (Lichtsteiner, Posch and Delbruck 2008), taken here as the corner of each pole. So 67 lux give
    the 200 Hz that the paper calls daytime and 17 lux its 50 Hz of nighttime: indoor light, by
    photographers' standards. Give `cutoff_reference` the radiance of white as well, and darker
    surfaces are slower in proportion.
    """
    lux = real("illuminance_lux", illuminance_lux, "a positive number")
    if not 0 < lux < math.inf:
        raise refusal("illuminance_lux", illuminance_lux, "a positive number")
    return _CUTOFF_HZ_PER_LUX * lux


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """An event camera: its pixel grid and its pixels' electronics.

    Parameters
    ----------
    width, height
        Pixels of the sensor. Its field of view is the frames' whatever its size, so a finer sensor
        has smaller pixels, not a wider view. Pixels are square: the frames must have the sensor's
        shape, as nearly as whole pixels allow (346x259 and 346x260 both suit 1280x960).
    contrast_threshold
        C of Eq. (1), in units of log intensity. The paper uses 0.2.
    cutoff_hz
        f_cutoff, the corner frequency of each of the photoreceptor's two poles; `math.inf` is the
        ideal pixel, the paper's day is 200 Hz and its night 50 Hz. The cascade of both poles is
        3 dB down at 0.644 f_cutoff already.
    dark_level
        I_dark of `u = log(I + I_dark)`, in the frames' unit of radiance. None means 1e-3 of the
        white level, for which the first frame's 99.9th percentile stands; 0 is allowed when every
        pixel of every frame is positive.
    random_start
        Start each pixel's memory at a seeded uniform offset in (-C, C) from the first frame, by the
        pixel's own thresholds, as if the sensor had been running; off, all pixels start in step, at
        exactly the first frame.
    poles
        Of the photoreceptor: 2, or 1 as in some simulators.
    cutoff_reference
        Radiance at which the cutoff is `cutoff_hz`; elsewhere it is proportional to I + I_dark, as
        a photoreceptor's bandwidth is to its photocurrent (Lichtsteiner et al. 2008). None: the
        cutoff is the same in all light.
    fill_factor
        Share of a pixel's area that sees light: a square in its middle.
    threshold_mismatch
        Standard deviation of C from pixel to pixel, log units, drawn apart for ON and OFF and never
        below a tenth of C (fixed pattern; 0.02 to 0.03 in Lichtsteiner et al. 2008 and v2e).
    leak_hz
        Rate of ON events of a pixel in constant light, from junction leakage in its reset switch
        (Nozaki and Delbruck 2017; 0.1 Hz is usual).
    shot_noise_hz
        Rate of noise events of a pixel in the dark, ON and OFF together, a Poisson process. In
        light it is lower by ((I + I_dark) / I_dark) ** -shot_noise_exponent.
    shot_noise_exponent
        0.5 by default, as the photon noise relative to the light falls.
    hot_pixel_fraction, hot_pixel_hz
        Share of pixels that fire noise at this rate in any light.
    refractory_s
        Time after an event in which a pixel's events are lost. Its memory moves on all the same:
        what is lost is the report, not the measurement.

    Raises
    ------
    SensorError
        A parameter is outside its range, or no number; the text names it.
    """

    width: int
    height: int
    contrast_threshold: float = 0.2
    cutoff_hz: float = math.inf
    dark_level: float | None = None
    random_start: bool = False
    poles: int = 2
    cutoff_reference: float | None = None
    fill_factor: float = 1.0
    threshold_mismatch: float = 0.0
    leak_hz: float = 0.0
    shot_noise_hz: float = 0.0
    shot_noise_exponent: float = 0.5
    hot_pixel_fraction: float = 0.0
    hot_pixel_hz: float = 100.0
    refractory_s: float = 0.0

    def __post_init__(self) -> None:
        def check(name: str, holds: bool, expected: str) -> None:
            if not holds:
                raise refusal(f"SensorModel.{name}", getattr(self, name), expected)

        def check_number(
            name: str,
            expected: str,
            holds: Callable[[float], bool],
            kind: Callable[[str, object, str], float] = real,
        ) -> None:
            number = kind(f"SensorModel.{name}", getattr(self, name), expected)
            check(name, holds(number), expected)
            object.__setattr__(self, name, number)  # Python's own: a file's JSON has no NumPy

        for name in ("width", "height"):
            expected = f"an integer in 1..{MAX_SIDE_PX}"
            check_number(name, expected, lambda side: 1 <= side <= MAX_SIDE_PX, whole)
        check_number("poles", "1 or 2", lambda poles: poles in (1, 2), whole)
        check_number(
            "contrast_threshold",
            "a positive number (log units; 0.2 is usual)",
            lambda C: 0 < C < math.inf,
        )
        check_number(
            "cutoff_hz", "a positive number of Hz, or inf for an ideal pixel", lambda hz: hz > 0
        )
        if self.dark_level is not None:
            check_number(
                "dark_level",
                "0, or a radiance from 1e-300 to 1e300, or None",
                lambda dark: dark == 0 or 1e-300 <= dark <= 1e300,
            )
        if self.cutoff_reference is not None:
            check_number(
                "cutoff_reference",
                "a positive radiance, and a finite cutoff_hz to go with it, or None",
                lambda reference: 0 < reference < math.inf and self.cutoff_hz < math.inf,
            )
        check_number("fill_factor", "a share in (0, 1]", lambda share: 0 < share <= 1)
        check_number("hot_pixel_fraction", "a share in [0, 1]", lambda share: 0 <= share <= 1)
        for name in ("threshold_mismatch", "shot_noise_exponent", "refractory_s"):
            check_number(name, "a number of at least 0", lambda number: 0 <= number < math.inf)
        for name in ("leak_hz", "shot_noise_hz", "hot_pixel_hz"):
            expected = f"Hz from 0 to {MAX_RATE_HZ:g}, one event a microsecond"
            check_number(name, expected, lambda hz: 0 <= hz <= MAX_RATE_HZ)
        check(
            "shot_noise_hz",
            self.shot_noise_hz == 0 or self.dark_level != 0,
            "0 where dark_level is 0: its fall with the light starts from the dark level",
        )
        check("random_start", isinstance(self.random_start, bool | np.bool_), "True or False")
        object.__setattr__(self, "random_start", bool(self.random_start))
