"""Options of an inertial measurement unit on the camera."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from eres_render.storage.json_values import use_python_numbers
from tasks.errors import TaskError


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuOptions:
    """An inertial measurement unit; its noise is by default that of EuRoC's ADIS16448.

    Noise densities and random walks have the units of Kalibr.

    Parameters
    ----------
    imu
        Add an inertial measurement unit with this rate, Hz. By default there is none.
    gyroscope_noise
        White noise of the angular velocity, rad/s/sqrt(Hz).
    gyroscope_walk
        Random walk of the gyroscope's bias, rad/s^2/sqrt(Hz).
    accelerometer_noise
        White noise of the specific force, m/s^2/sqrt(Hz).
    accelerometer_walk
        Random walk of the accelerometer's bias, m/s^3/sqrt(Hz).
    """

    imu: float | None = None
    gyroscope_noise: float = 1.6968e-4
    gyroscope_walk: float = 1.9393e-5
    accelerometer_noise: float = 2.0e-3
    accelerometer_walk: float = 3.0e-3

    def __post_init__(self) -> None:
        use_python_numbers(self)

    def check(self) -> None:
        """Refuse impossible values.

        Raises
        ------
        TaskError
            The text names the option.
        """
        values = asdict(self)
        if (rate_hz := values.pop("imu")) is not None and not 0 < rate_hz <= 1e6:
            raise TaskError(f"imu: found {rate_hz:g} Hz, expected above 0 and at most 1e6")
        for name, value in values.items():
            if not 0 <= value < math.inf:
                raise TaskError(f"{name}: found {value}, expected a finite number, 0 or more")
            if rate_hz is None and value != getattr(NO_IMU, name):
                raise TaskError(f"--{name.replace('_', '-')} {value} needs an IMU, --imu HZ")


NO_IMU = ImuOptions()
