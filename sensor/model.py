"""`SensorModel`: all parameters that determine the events for given light."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from sensor.numbers import real, refusal, whole

MAX_SIDE_PX = 1 << 16  # event coordinates are uint16
MAX_RATE_HZ = 1e6  # event times are whole microseconds
MAX_TIME_S = 9.2e12  # 2^63 us, nearly
MIN_THRESHOLD, MAX_THRESHOLD = 1e-9, 1e6  # a double resolves far smaller steps
MIN_FILL_FACTOR = 1e-6
_CUTOFF_HZ_PER_LUX = 3.0

Photoreceptor = Literal["two_pole", "one_pole", "v2e"]
PHOTORECEPTORS: tuple[str, ...] = get_args(Photoreceptor)


def cutoff_in_light(illuminance_lux: float) -> float:
    """Return the photoreceptor cutoff in Hz for the illuminance of a scene in lux.

    Bandwidth is proportional to photocurrent. A DVS128 has 3 kHz at 1 klux (Lichtsteiner, Posch and
    Delbruck 2008), used here as the corner of each pole. So 67 lux give 200 Hz, the paper's
    daytime, and 17 lux 50 Hz, its nighttime; both are usual indoor light. With `cutoff_reference`
    at the radiance of white, darker surfaces have a proportionally lower cutoff.

    Raises
    ------
    SensorError
        The illuminance is not a positive number.

    Examples
    --------
    >>> from sensor import SensorModel, cutoff_in_light
    >>> cutoff_in_light(17)  # a dim room
    51.0
    >>> SensorModel(width=346, height=260, cutoff_hz=cutoff_in_light(17)).cutoff_hz
    51.0
    """
    lux = real("illuminance_lux", illuminance_lux, "a positive number")
    if not 0 < lux < math.inf:
        raise refusal("illuminance_lux", illuminance_lux, "a positive number")
    return _CUTOFF_HZ_PER_LUX * lux


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """An event camera: its pixel grid and the electronics of its pixels.

    Parameters
    ----------
    width, height
        Size in pixels. The field of view is always that of the frames, so a finer sensor has
        smaller pixels, not a wider view. Pixels are square: frames must have the aspect ratio of
        the sensor, to less than one pixel (346x259 and 346x260 both fit 1280x960).
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
        Start the memory of each pixel at a random, uniform offset in (-C, C) from the first frame,
        with the thresholds of that pixel, as if the sensor had been running in changing light. If
        False, all memories start exactly at the first frame.
    photoreceptor
        "two_pole", two equal poles in series; "one_pole"; or "v2e", v2e's limit for small steps:
        the filter of v2e since March 2021 (Hu, Liu and Delbruck 2021), one pole with the cutoff
        `cutoff_hz` (v + 20) / 275, where v is the light on a scale with white at 255, but solved
        exactly, not by v2e's one step per frame. Between two frames the cutoff is constant, that of
        the mean of their log intensities.
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
        (Nozaki and Delbruck 2017; 0.1 Hz is usual). It is that of the threshold C: with mismatch a
        pixel of threshold C_i leaks at C / C_i times this rate, 2 % more in the mean at usual
        values. In light that is constant from the first frame on, the first event comes after
        1 / leak_hz, 10 s at 0.1 Hz, in all pixels at once; with `random_start` events come at half
        the rate until then.
    shot_noise_hz
        Rate of noise events of a pixel in the dark, ON and OFF together, a Poisson process. The
        rate in light is lower by the factor ((I + I_dark) / I_dark) ** -shot_noise_exponent.
    shot_noise_exponent
        0.5 by default, the exponent of photon noise relative to the light.
    hot_pixel_fraction, hot_pixel_hz
        Share of hot pixels, and the rate of noise events of each, which does not depend on light.
    refractory_s
        Time after an event in which further events of the pixel are lost. Its memory changes by C
        all the same, as if the event had been reported.
    latency_s
        Delay from the crossing of a threshold to the time of the event, the same for all events;
        the delay of the photoreceptor comes before it.

    Raises
    ------
    SensorError
        A parameter is outside its range, or not a number; the text names it.

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
            object.__setattr__(self, name, number)  # a Python number, for JSON

        for name in ("width", "height"):
            expected = f"an integer in 1..{MAX_SIDE_PX}"
            check_number(name, expected, lambda side: 1 <= side <= MAX_SIDE_PX, whole)
        check(
            "photoreceptor",
            isinstance(self.photoreceptor, str) and self.photoreceptor in PHOTORECEPTORS,
            " or ".join(map(repr, PHOTORECEPTORS)),
        )
        for name in ("contrast_threshold", "contrast_threshold_off"):
            if name == "contrast_threshold" or self.contrast_threshold_off is not None:
                check_number(
                    name,
                    f"a number from {MIN_THRESHOLD:g} to {MAX_THRESHOLD:g} (log units; 0.2 "
                    "is usual)",
                    lambda C: MIN_THRESHOLD <= C <= MAX_THRESHOLD,
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
        check_number(
            "fill_factor",
            f"a share from {MIN_FILL_FACTOR:g} to 1",
            lambda share: MIN_FILL_FACTOR <= share <= 1,
        )
        check_number("hot_pixel_fraction", "a share in [0, 1]", lambda share: 0 <= share <= 1)
        check_number(
            "refractory_s",
            f"seconds from 0 to {MAX_TIME_S:g}",
            lambda period: 0 <= period <= MAX_TIME_S,
        )
        for name in ("threshold_mismatch", "shot_noise_exponent"):
            check_number(name, "a number of at least 0", lambda number: 0 <= number < math.inf)
        check_number("latency_s", "seconds from 0 to 1000", lambda delay: 0 <= delay <= 1000)
        for name in ("leak_hz", "shot_noise_hz", "hot_pixel_hz"):
            expected = f"Hz from 0 to {MAX_RATE_HZ:g}, one event per microsecond"
            check_number(name, expected, lambda hz: 0 <= hz <= MAX_RATE_HZ)
        check(
            "shot_noise_hz",
            self.shot_noise_hz == 0 or self.dark_level != 0,
            "0 where dark_level is 0, since the rate in light is relative to the dark level",
        )
        check("random_start", isinstance(self.random_start, bool | np.bool_), "True or False")
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
