"""`DatasetSettings`: the settings of a dataset, their file, and what the sequences take."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eres_render.cores import cores
from eres_render.errors import check_positive, check_spp
from eres_render.progress import cost
from eres_render.random_scenes.random_scene import MAX_LIGHT
from eres_render.random_scenes.random_scene import VERSION as SCENE_VERSION
from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.atomic import write_text
from eres_render.storage.json_values import json_values, use_python_numbers
from eres_render.storage.settings_reader import read_json
from sensor import EventCamera
from sensor.cameras.files import values_of
from sensor.model import SensorModel
from tasks.errors import TaskError
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.warm_up import needed_s

FILE_NAME = "dataset.json"

_MIN_HZ = 0.01  # warms up for a minute and a half
_MAX_DEVIATIONS = 2.0  # standard deviations of a threshold from the mean
_MAX_M = 0.3  # largest baseline of a pair of cameras

# Means over the first 100 (motion) or 5 (the rest) random scenes of seed 0, on a virtual AMD EPYC
# server, with LLVM.
_MOTION_WIDTHS_S = 0.8  # motion of the fastest part of the image, image widths per second
_EVENTS_PER_PX_S = 55
_BYTES_A_FRAME_PX = 1.5
BYTES_A_TRUTH_PX, BYTES_AN_EVENT = 7.5, 2.8
# CPU time
_SEQUENCE_S, _FRAME_S, _SAMPLE_S = 6.0, 12e-3, 110e-9
_MAX_CORES = 2  # cores that one sequence keeps busy


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasetSettings:
    """Settings of the sequences of a dataset.

    The number of sequences is not a setting, as it changes none of them.

    Parameters
    ----------
    seed
        Seed of the dataset; with the same settings, sequence k depends only on it and on k.
    seconds
        Length of each sequence, after its warm-up, s.
    sensor
        The event camera with its bus. Frames have its size. All sequences have the same dark level,
        a share of the white of the brightest scene.
    cutoffs_hz
        Corner frequencies of the photoreceptor's poles; one file of events for each.
    threshold_deviation
        Standard deviation of the contrast threshold across sequences, log units. The mean is the
        sensor's threshold, and thresholds stay within two standard deviations of it. The ratio of
        OFF to ON threshold is fixed.
    imu
        An IMU at the position of the camera; none without a rate.
    images_hz
        Rate of the images of a frame camera; None for no images.
    camera
        The frame camera.
    baseline_m
        Distance of a second, right camera on the same rig, m; None for one camera.
    spp
        Samples per pixel.
    max_displacement_px
        Largest motion in the image between two frames, px.
    truth_step_s
        Time between the images of the ground truth, s.
    warm_up_s
        How long the sensor sees the scene before a sequence starts, s; rounded up to whole
        microseconds.
    scene_version
        Version of the generator of scenes.

    Raises
    ------
    TaskError, SensorError
        A value is out of range.
    """

    seed: int
    seconds: float
    sensor: EventCamera
    cutoffs_hz: tuple[float, ...] = (math.inf,)
    threshold_deviation: float = 0.03
    imu: ImuOptions = NO_IMU
    images_hz: float | None = None
    camera: FrameCameraOptions = USUAL_CAMERA
    baseline_m: float | None = None
    spp: int = 4
    max_displacement_px: float = 0.5
    truth_step_s: float = 0.05
    warm_up_s: float = WARM_UP_S
    scene_version: int = SCENE_VERSION

    def __post_init__(self) -> None:
        use_python_numbers(self)
        object.__setattr__(self, "cutoffs_hz", tuple(float(hz) for hz in self.cutoffs_hz))
        object.__setattr__(self, "warm_up_s", _whole_microseconds(self.warm_up_s))

        def check(name: str, holds: bool, expected: str) -> None:
            if not holds:
                raise TaskError(f"{name}: found {getattr(self, name)}, expected {expected}")

        check("seed", self.seed >= 0, "at least 0")
        check_positive("max_displacement_px", self.max_displacement_px, TaskError)
        for name in ("seconds", "truth_step_s"):
            check(name, 1e-6 <= getattr(self, name) < math.inf, "at least a microsecond")
        cutoffs = self.cutoffs_hz
        fits = len({f"{hz:g}" for hz in cutoffs if hz >= _MIN_HZ}) == len(cutoffs) > 0
        check("cutoffs_hz", fits, f"{_MIN_HZ:g} Hz or more, different in the first six digits")
        needs_s = needed_s(min(cutoffs), 1.0, self.warm_up_s)
        least = f"at least {_whole_microseconds(needs_s):.10g} s for {min(cutoffs):g} Hz"
        check("warm_up_s", needs_s == self.warm_up_s, least)
        check_spp(self.spp, TaskError)
        limit = self.sensor.contrast_threshold / _MAX_DEVIATIONS
        fits = 0 <= self.threshold_deviation < limit
        check("threshold_deviation", fits, f"0 or more, and less than {limit:g}")
        fits = self.baseline_m is None or 0 < self.baseline_m <= _MAX_M
        check("baseline_m", fits, f"above 0 and at most {_MAX_M} m")
        self.imu.check()
        self.camera.check()
        rate_hz, exposure_s = self.images_hz, self.camera.exposure
        if rate_hz is None:
            check("images_hz", self.camera == USUAL_CAMERA, "a rate for the frame camera")
        else:
            longest_s = self.warm_up_s + self.seconds
            fits = 0 < rate_hz <= 1 / exposure_s and exposure_s <= longest_s
            within = f"that neither overlap nor outlast the {longest_s:g} s of a sequence"
            check("images_hz", fits, f"a positive rate, and exposures {within}")
        self.models(0, 1.0)

    def models(self, number: int, white_level: float) -> dict[str, SensorModel]:
        """Return the sensors of a sequence.

        Parameters
        ----------
        number
            Number of the sequence.
        white_level
            Radiance of white in its frames.

        Returns
        -------
        models
            Sensors by their cutoff, "inf" or in Hz; all with the same contrast threshold.

        Raises
        ------
        SensorError
            The sensor has no size.
        """
        away = self._rng(number).normal(0.0, 1.0)
        away = float(np.clip(away, -_MAX_DEVIATIONS, _MAX_DEVIATIONS))
        C = self.sensor.contrast_threshold + away * self.threshold_deviation
        camera = self.sensor.with_threshold(C)
        return {
            f"{hz:g}": camera.model(cutoff_hz=hz, white=white_level, dark_white=MAX_LIGHT)
            for hz in self.cutoffs_hz
        }

    def sensor_seed(self, number: int) -> int:
        """Return the seed of everything random in the sensors of a sequence."""
        return int(self._rng(number).integers(1 << 63))

    def _rng(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, number, 1])


def _whole_microseconds(seconds: float) -> float:
    return math.ceil(round(1e6 * seconds, 3)) / 1e6


def estimate(settings: DatasetSettings, count: int) -> str:
    """Describe in one line what sequences take."""
    views = count * (1 if settings.baseline_m is None else 2)
    width, height = settings.sensor.size
    pixels = width * height
    seconds = settings.warm_up_s + settings.seconds
    motion_px = _MOTION_WIDTHS_S * width * seconds
    frames = views * (2 + motion_px / settings.max_displacement_px)
    events = views * _EVENTS_PER_PX_S * pixels * seconds
    truths = views * settings.seconds / settings.truth_step_s
    a_file = events * BYTES_AN_EVENT + truths * pixels * BYTES_A_TRUTH_PX
    disk_bytes = frames * pixels * _BYTES_A_FRAME_PX + len(settings.cutoffs_hz) * a_file
    cpu_s = views * _SEQUENCE_S + frames * (_FRAME_S + pixels * settings.spp * _SAMPLE_S)
    takes = cost(disk_bytes, cpu_s / min(cores(), _MAX_CORES))
    return f"{count} sequence{'s' * (count != 1)} to make: about {frames:.0f} frames, {takes}"


def claim_folder(settings: DatasetSettings, out: Path) -> None:
    """Write the settings of a dataset into its folder, or check that they match those in it."""
    claim_table({**json_values(settings), "sensor": values_of(settings.sensor)}, out)


def claim_table(table: dict[str, Any], out: Path) -> None:
    """Write settings as values for JSON into a folder, or check that they match those in it."""
    file = out / FILE_NAME
    if file.exists():
        old = read_json(dict[str, Any], file, TaskError)
        for name in {**table, **old}:
            if old.get(name) != table.get(name):
                raise TaskError(
                    f"{file}: {name} is {old.get(name)!r} in this folder, but {table.get(name)!r} "
                    "was requested; use the same options, or choose another folder"
                )
        return
    if out.is_dir() and any(path.name[0] != "." for path in out.iterdir()):
        raise TaskError(f"{out}: contains other files; choose a new folder, or that of a dataset")
    write_text(file, json.dumps(table, indent=1) + "\n")
