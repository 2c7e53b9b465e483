"""Options of a frame camera at the place of the event camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eres_render.storage.json_values import use_python_numbers
from tasks.errors import TaskError

_MAX_ELECTRONS = 1e15
_MIN_EXPOSURE_S = 1e-6  # frames.csv has whole microseconds


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameCameraOptions:
    """A global-shutter camera that takes 8-bit gray images.

    Parameters
    ----------
    exposure
        Exposure time, seconds.
    full_well
        Electrons of a white pixel; they set the photon noise. inf is a camera without noise.
    read_noise
        Standard deviation of the read noise, electrons.
    """

    exposure: float = 0.005
    full_well: float = 10_000.0
    read_noise: float = 10.0

    def __post_init__(self) -> None:
        use_python_numbers(self)

    def check(self) -> None:
        """Refuse impossible values.

        Raises
        ------
        TaskError
            The text names the option.
        """
        seconds, well, noise = self.exposure, self.full_well, self.read_noise
        if not _MIN_EXPOSURE_S <= seconds < math.inf:
            expected = f"at least {_MIN_EXPOSURE_S:g} seconds"
            raise TaskError(f"exposure: found {seconds}, expected {expected}")
        if not (0 < well <= _MAX_ELECTRONS or well == math.inf):
            expected = f"a positive number of at most {_MAX_ELECTRONS:g}, or inf"
            raise TaskError(f"full_well: found {well}, expected {expected}")
        if not 0 <= noise < math.inf:
            raise TaskError(f"read_noise: found {noise}, expected a finite number, 0 or more")


USUAL_CAMERA = FrameCameraOptions()
