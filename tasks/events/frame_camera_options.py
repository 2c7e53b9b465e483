"""Options of a frame camera at the place of the event camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eres_render.storage.json_values import use_python_numbers
from tasks.errors import TaskError

_MAX_ELECTRONS = 1e15
_MIN_EXPOSURE_S = 1e-6  # frames.csv has whole microseconds
_EXPECTED = {
    "exposure": f"at least {_MIN_EXPOSURE_S:g} seconds",
    "full_well": f"a positive number of at most {_MAX_ELECTRONS:g}, or inf",
    "read_noise": "a finite number, 0 or more",
}


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
        well = self.full_well
        possible = {
            "exposure": _MIN_EXPOSURE_S <= self.exposure < math.inf,
            "full_well": 0 < well <= _MAX_ELECTRONS or well == math.inf,
            "read_noise": 0 <= self.read_noise < math.inf,
        }
        for name, is_possible in possible.items():
            if not is_possible:
                raise TaskError(f"{name}: found {getattr(self, name)}, expected {_EXPECTED[name]}")


USUAL_CAMERA = FrameCameraOptions()
