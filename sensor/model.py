"""`SensorModel`: all parameters that determine the events for given light."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sensor.numbers import FINITE, POSITIVE, real, refusal, whole

MAX_SIDE_PX = 1 << 16  # event coordinates are uint16
MAX_RATE_HZ = 1e6  # event times are whole microseconds
MAX_TIME_S = 9.2e12  # 2^63 us, nearly
MIN_THRESHOLD, MAX_THRESHOLD = 1e-9, 1e6  # a double resolves far smaller steps
MIN_FILL_FACTOR = 1e-6
_MIN_DARK = 1e-300
_CUTOFF_HZ_PER_LUX = 3.0

Photoreceptor = Literal["two_pole", "one_pole", "v2e"]
PHOTORECEPTORS: tuple[str, ...] = get_args(Photoreceptor)

# Smallest and largest value of each number, and both in words.
_SIDE = 1, MAX_SIDE_PX, f"an integer in 1..{MAX_SIDE_PX}"
_NUMBER = 0, FINITE, "a finite number, 0 or more"
_RATE = 0, MAX_RATE_HZ, f"a rate from 0 to {MAX_RATE_HZ:g} Hz, one event per microsecond"
_LOG_UNITS = f"a number from {MIN_THRESHOLD:g} to {MAX_THRESHOLD:g} (log units; 0.2 is usual)"
_THRESHOLD = MIN_THRESHOLD, MAX_THRESHOLD, _LOG_UNITS
BOUNDS: dict[str, tuple[float, float, str]] = {
    "width": _SIDE,
    "height": _SIDE,
    "contrast_threshold": _THRESHOLD,
    "contrast_threshold_off": _THRESHOLD,
    "cutoff_hz": (POSITIVE, math.inf, "a positive number of Hz, or inf for an ideal pixel"),
    "dark_level": (0, 1e300, f"0, or a radiance from {_MIN_DARK:g} to 1e300, or None"),
    "cutoff_reference": (POSITIVE, FINITE, "a positive radiance with a finite cutoff_hz, or None"),
    "fill_factor": (MIN_FILL_FACTOR, 1, f"a share from {MIN_FILL_FACTOR:g} to 1"),
    "threshold_mismatch": _NUMBER,
    "leak_hz": _RATE,
    "shot_noise_hz": _RATE,
    "shot_noise_exponent": _NUMBER,
    "hot_pixel_fraction": (0, 1, "a share in [0, 1]"),
    "hot_pixel_hz": _RATE,
    "refractory_s": (0, MAX_TIME_S, f"seconds from 0 to {MAX_TIME_S:g}"),
    "latency_s": (0, 1000, "seconds from 0 to 1000"),
}
_OPTIONAL = "contrast_threshold_off", "dark_level", "cutoff_reference"
_EXPECTED = {name: expected for name, (_, _, expected) in BOUNDS.items()} | {
    "photoreceptor": " or ".join(map(repr, PHOTORECEPTORS)),
    "shot_noise_hz": "0, since dark_level is 0 and the rate is relative to the dark level",
    "random_start": "True or False",
}


def cutoff_in_light(illuminance_lux: float) -> float:
    """Return the photoreceptor cutoff in Hz for the illuminance of a scene in lux.

    Bandwidth is proportional to photocurrent. A DVS128 has 3 kHz at 1 klux (Lichtsteiner, Posch and
    Delbruck 2008), used here as the corner of each pole. So 67 lux give 200 Hz, the paper's
    daytime, and 17 lux give 50 Hz, its nighttime; both are usual indoor light. If
    `cutoff_reference` is the radiance of white, darker surfaces have a proportionally lower cutoff.

    Raises
    ------
    SensorError
        The illuminance is not a finite positive number.

    Examples
    --------
    >>> from sensor import SensorModel, cutoff_in_light
    >>> cutoff_in_light(17)  # a dim room
    51.0
    >>> SensorModel(width=346, height=260, cutoff_hz=cutoff_in_light(17)).cutoff_hz
    51.0
    """
    expected = "a positive number"
    return _CUTOFF_HZ_PER_LUX * real("illuminance_lux", illuminance_lux, expected, POSITIVE, FINITE)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """An event camera: its pixel grid and the electronics of its pixels.

    Parameters
    ----------
    width, height
        Size in pixels. The sensor always sees the whole frame, so a finer sensor has smaller
        pixels, not a wider view. Pixels are square: frames must have the aspect ratio of the
        sensor, to less than one pixel (346x259 and 346x260 both fit 1280x960).
    contrast_threshold
        C of Eq. (1), in units of log intensity. The paper uses 0.2.
    contrast_threshold_off
        C of OFF events; None is `contrast_threshold`, which then holds for both.
    cutoff_hz
        f_cutoff, the corner frequency of each pole of the photoreceptor. `math.inf` is the ideal
        pixel; the paper uses 200 Hz for day and 50 Hz for night. The -3 dB point of two poles
        together is 0.644 f_cutoff.
    dark_level
        I_dark of `u = log(I + I_dark)`, in the radiance unit of the frames. None is 1e-3 of the
        white level, the 99.9th percentile of the first frame; 0 is allowed if every pixel of every
        frame is positive.
    random_start
        Start the memory of each pixel at a random offset from the first frame, uniform between the
        pixel's own thresholds, as if the sensor had been running in changing light. If False, all
        memories start exactly at the first frame.
    photoreceptor
        "two_pole", two equal poles in series; "one_pole"; or "v2e", v2e's limit for small steps:
        the filter of v2e since March 2021 (Hu, Liu and Delbruck 2021). It is one pole with the
        cutoff `cutoff_hz` (v + 20) / 275, where v is the light on a scale with white at 255. It is
        solved exactly, while v2e takes one step per frame. Between two frames the cutoff is
        constant: its value at the mean of their log intensities.
    cutoff_reference
        The I + I_dark at which the cutoff is `cutoff_hz`; the cutoff is proportional to it, since
        bandwidth is proportional to photocurrent (Lichtsteiner et al. 2008). None: the cutoff does
        not depend on the light. With "v2e" it is the radiance of white, and None is the 99.9th
        percentile of the first frame.
    fill_factor
        Light-sensitive share of the area of a pixel, a square at its center. Frames should have at
        least three samples along a pixel: with one or two, samples that the square covers in equal
        parts give the mean of the whole pixel.
    threshold_mismatch
        Standard deviation of C over the pixels, log units; 0.02 to 0.03 in Lichtsteiner et al. 2008
        and v2e. The pattern is fixed, and independent for ON and OFF; thresholds are at least
        C / 10.
    leak_hz
        Rate of ON events of a pixel in constant light, due to junction leakage in its reset switch
        (Nozaki and Delbruck 2017; 0.1 Hz is usual). Defined at the nominal C: with mismatch, a
        pixel with threshold C_i leaks at C / C_i times this rate, about 2 % more on average at
        usual values. In light that is constant from the first frame on, all pixels fire first after
        1 / leak_hz, 10 s at 0.1 Hz. With `random_start`, events come at half the rate until then.
    shot_noise_hz
        Rate of noise events of a pixel in the dark, ON and OFF together, a Poisson process. The
        rate in light is lower by the factor ((I + I_dark) / I_dark) ** -shot_noise_exponent.
    shot_noise_exponent
        0.5 by default, the exponent of photon noise relative to the light.
    hot_pixel_fraction, hot_pixel_hz
        Share of hot pixels, and the rate of noise events of each, which does not depend on light.
    refractory_s
        Time after an event in which further events of the pixel are lost. The memory still changes
        by C, as if the event had been reported.
    latency_s
        Delay from the crossing of a threshold to the time of the event, the same for all events. It
        adds to the delay of the photoreceptor.

    Raises
    ------
    SensorError
        A parameter is out of range or not a number; the message names it.

    Examples
    --------
    A DAVIS346 by day, and the same camera by night with the noise of its pixels:

    >>> from dataclasses import replace
    >>> from sensor import SensorModel
    >>> day = SensorModel(width=346, height=260, contrast_threshold=0.2, cutoff_hz=200.0)
    >>> night = replace(day, cutoff_hz=50.0, threshold_mismatch=0.03, leak_hz=0.1)
    >>> night.contrast_threshold, night.cutoff_hz, night.threshold_mismatch
    (0.2, 50.0, 0.03)
    """

    width: int
    height: int
    contrast_threshold: float = 0.2
    contrast_threshold_off: float | None = None
    cutoff_hz: float = math.inf
    dark_level: float | None = None
    random_start: bool = False
    photoreceptor: Photoreceptor = "two_pole"
    cutoff_reference: float | None = None
    fill_factor: float = 1.0
    threshold_mismatch: float = 0.0
    leak_hz: float = 0.0
    shot_noise_hz: float = 0.0
    shot_noise_exponent: float = 0.5
    hot_pixel_fraction: float = 0.0
    hot_pixel_hz: float = 100.0
    refractory_s: float = 0.0
    latency_s: float = 0.0

    def __post_init__(self) -> None:
        for name, (low, high, expected) in BOUNDS.items():
            value = getattr(self, name)
            if value is not None or name not in _OPTIONAL:
                check = whole if name in ("width", "height") else real
                number = check(f"SensorModel.{name}", value, expected, low, high)
                object.__setattr__(self, name, number)  # a Python number, for JSON
        dark, is_filtered = self.dark_level, self.cutoff_hz < math.inf
        rules = {
            "photoreceptor": self.photoreceptor in PHOTORECEPTORS,
            "dark_level": dark is None or dark == 0 or dark >= _MIN_DARK,
            "cutoff_reference": self.cutoff_reference is None or is_filtered,
            "shot_noise_hz": self.shot_noise_hz == 0 or dark != 0,
            "random_start": isinstance(self.random_start, bool | np.bool_),
        }
        for name, holds in rules.items():
            if not holds:
                raise refusal(f"SensorModel.{name}", getattr(self, name), _EXPECTED[name])
        object.__setattr__(self, "random_start", bool(self.random_start))

    @property
    def poles(self) -> int:
        """Number of poles of the photoreceptor, 1 or 2."""
        return 2 if self.photoreceptor == "two_pole" else 1

    @property
    def off_threshold(self) -> float:
        """C of OFF events, log units."""
        C_off = self.contrast_threshold_off
        return self.contrast_threshold if C_off is None else C_off
