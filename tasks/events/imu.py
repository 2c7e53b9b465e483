"""An inertial measurement unit at the place of the camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eres_render import RadianceSequence, Trajectory
from sensor.formats.hdf5_file import writable
from tasks.events.imu_options import ImuOptions

Float64 = NDArray[np.float64]

GRAVITY_MPS2 = 9.80665
"""Standard gravity; the world's z axis points up."""


class Measured(NamedTuple):
    """What an IMU measures at (N,) times, along the camera's axes."""

    gyroscope: Float64  # (N, 3) angular velocity, rad/s
    accelerometer: Float64  # (N, 3) specific force, m/s^2
    gyroscope_bias: Float64  # (N, 3), included in the angular velocity
    accelerometer_bias: Float64  # (N, 3), included in the specific force


def measure(
    trajectory: Trajectory, t_s: Float64, options: ImuOptions, seed: int, speed: float = 1.0
) -> Measured:
    """Return what an IMU on a camera measures.

    The specific force is the camera's acceleration minus that of gravity: at rest it points up with
    9.80665 m/s^2, and in free fall it is zero. Derivatives of the path are exact. Biases start at
    zero. With steps of dt, white noise of density n has the standard deviation n / sqrt(dt), and a
    bias of random walk w takes steps of standard deviation w sqrt(dt) (Kalibr's IMU noise model).

    Parameters
    ----------
    trajectory
        The path; the world's z axis points up.
    t_s
        (N,) times on the path, evenly spaced, s.
    options
        The noise.
    seed
        Seed of the noise.
    speed
        Factor by which the scene moves faster than on the path.

    Returns
    -------
    measured
        The measurements.
    """
    R = trajectory.pose(t_s)[:, :3, :3]
    force = speed**2 * trajectory.acceleration(t_s) + (0.0, 0.0, GRAVITY_MPS2)
    specific_force = np.einsum("nij,ni->nj", R, force)
    angular_velocity = speed * trajectory.angular_velocity(t_s)
    dt_s = float(t_s[1] - t_s[0]) / speed if len(t_s) > 1 else 1.0
    rng = np.random.default_rng(seed)

    def noisy(exact: Float64, density: float, walk: float) -> tuple[Float64, Float64]:
        steps = walk * math.sqrt(dt_s) * rng.standard_normal(exact.shape)
        bias = np.cumsum(steps, axis=0) - steps[:1]
        white = density / math.sqrt(dt_s) * rng.standard_normal(exact.shape)
        return exact + bias + white, bias

    gyroscope = noisy(angular_velocity, options.gyroscope_noise, options.gyroscope_walk)
    accelerometer = noisy(specific_force, options.accelerometer_noise, options.accelerometer_walk)
    return Measured(gyroscope[0], accelerometer[0], gyroscope[1], accelerometer[1])


def imu_to_add(
    sequence: RadianceSequence, options: ImuOptions, speed: float, seed: int
) -> Callable[[Path], None]:
    """Return a function that adds an IMU to a DSEC file of events.

    The file's group `imu` holds, at times `t_us` (N,) on the events' clock from the first frame to
    the last, the fields of `Measured`. Attributes state the options and gravity.

    Parameters
    ----------
    sequence
        The sequence.
    options
        The IMU, with a rate.
    speed
        Factor by which the scene moves faster than it was rendered.
    seed
        Seed of the noise.

    Returns
    -------
    The function; it takes the path of the file.
    """
    assert options.imu is not None
    options.check()
    start_s, end_s = sequence.t_s[[0, -1]]
    step_s = speed / options.imu
    t_s = start_s + step_s * np.arange(math.floor((end_s - start_s) / step_s + 1e-9) + 1)
    t_s = np.minimum(t_s, end_s)
    measured = measure(sequence.trajectory, t_s, options, seed, speed)

    def add(path: Path) -> None:
        with writable(path, new=False) as (file, _):
            group = file.create_group("imu")
            group["t_us"] = sequence.t_offset_us + np.round(t_s / speed * 1e6).astype(np.int64)
            for name, values in measured._asdict().items():
                group[name] = values
            group.attrs.update({**asdict(options), "gravity_mps2": GRAVITY_MPS2})

    return add
