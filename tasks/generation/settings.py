"""`DatasetSettings`: the settings of a dataset, and their file."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from eres_render.errors import check_positive, check_spp
from eres_render.random_scenes.random_scene import MAX_LIGHT
from eres_render.random_scenes.random_scene import VERSION as SCENE_VERSION
from eres_render.sequence.clips import WARM_UP_S
from eres_render.storage.atomic import write_text
from eres_render.storage.json_values import json_values, use_python_numbers
from eres_render.storage.settings_reader import read_json
from sensor.cameras import EventCamera
from sensor.cameras.files import camera_of, values_of
from sensor.errors import SensorError
from sensor.model import SensorModel
from tasks.errors import TaskError
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.warm_up import needed_s

FILE_NAME = "dataset.json"

_MIN_HZ = 0.01  # warms up for a minute and a half
_MAX_DEVIATIONS = 2.0  # standard deviations of a threshold from the mean
_MAX_M = 0.3  # largest baseline of a pair of cameras


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
        The event camera, with its bus; the frames have its size. Its dark level is a share of the
        white of the brightest scene, for all.
    cutoffs_hz
        Corner frequencies of the photoreceptor's poles; one file of events for each.
    threshold_deviation
        Standard deviation over the sequences of the contrast threshold, whose mean is that of the
        sensor, log units; a threshold is at most two standard deviations away from the mean. That
        of OFF events keeps its ratio to that of ON events.
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
    TaskError
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

        check("seed", self.seed >= 0, "a whole number of at least 0")
        for name in ("seconds", "max_displacement_px", "truth_step_s"):
            check_positive(name, getattr(self, name), TaskError)
        check("seconds", self.seconds >= 1e-6, "at least a microsecond")
        cutoffs = self.cutoffs_hz
        different = bool(cutoffs) and len({f"{hz:g}" for hz in cutoffs}) == len(cutoffs)
        positive = all(one > 0 for one in cutoffs)  # and not NaN
        check(
            "cutoffs_hz", different and positive, "positive numbers of Hz that differ in six digits"
        )
        check("cutoffs_hz", min(cutoffs) >= _MIN_HZ, f"at least {_MIN_HZ:g} Hz")
        needs_s = needed_s(min(cutoffs), 1.0, self.warm_up_s)
        check(
            "warm_up_s",
            needs_s == self.warm_up_s,
            f"at least {_whole_microseconds(needs_s):.10g} s for {min(cutoffs):g} Hz",
        )
        check_spp(self.spp, TaskError)
        check("threshold_deviation", self.threshold_deviation >= 0, "a number of at least 0")
        most = self.sensor.contrast_threshold / _MAX_DEVIATIONS
        check("threshold_deviation", self.threshold_deviation < most, f"less than {most:g}")
        baseline_m = self.baseline_m
        fits = baseline_m is None or 0 < baseline_m <= _MAX_M
        check("baseline_m", fits, f"above 0 and at most {_MAX_M} m")
        self.imu.check()
        self.camera.check()
        rate_hz = self.images_hz
        fits = rate_hz is None or 0 < rate_hz <= 1 / self.camera.exposure
        check("images_hz", fits, "above 0, and exposures that do not overlap")
        fits = rate_hz is not None or self.camera == USUAL_CAMERA
        check("images_hz", fits, "a rate with an exposure, a full well or a read noise")
        check("truth_step_s", self.truth_step_s >= 1e-6, "at least a microsecond")
        exposure_s, whole_s = self.camera.exposure, self.warm_up_s + self.seconds
        if rate_hz is not None and exposure_s > whole_s:
            raise TaskError(
                f"exposure: found {exposure_s:g}, expected at most {whole_s:g} s, the length of a "
                "sequence"
            )
        try:
            self.models(0, 1.0)
        except SensorError as error:
            raise TaskError(str(error)) from error

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


def claim_folder(settings: DatasetSettings, out: Path) -> None:
    """Write the settings of a dataset into its folder, or check that they match those in it."""
    if out.exists() and not out.is_dir():
        raise TaskError(f"{out}: found a file, expected a folder for the dataset")
    file, table = out / FILE_NAME, _table(settings)
    if file.exists():
        old = read_json(dict[str, Any], file, TaskError)
        old = _with_later_fields(old)
        for name in {**table, **old}:
            if old.get(name) != table.get(name):
                raise TaskError(
                    f"{file}: {name}: found {old.get(name)!r}, expected {table.get(name)!r}; "
                    "continue with the same options, or write elsewhere"
                )
        return
    if out.is_dir() and any(path.name[0] != "." for path in out.iterdir()):
        raise TaskError(f"{out}: found other files, expected a new folder or that of a dataset")
    write_text(file, json.dumps(table, indent=1) + "\n")


def _table(settings: DatasetSettings) -> dict[str, Any]:
    """Return the settings as values for JSON: lists, and infinity as a text."""
    names = [one.name for one in dataclasses.fields(settings)]
    table = {name: json_values(getattr(settings, name)) for name in names if name != "sensor"}
    return {**table, "sensor": values_of(settings.sensor)}


def _with_later_fields(table: dict[str, Any]) -> dict[str, Any]:
    """Return a table of an older version with the fields of today.

    Older files have a number of poles in place of a photoreceptor, no warm-up, which was six time
    constants of the slowest cutoff, and `pixel`, `width`, `height` and `threshold` for the sensor.
    """
    slowest_hz = min(map(float, table.get("cutoffs_hz", ["inf"])))
    table = {"warm_up_s": _whole_microseconds(needed_s(slowest_hz, 1.0, 0.0)), **table}
    if "pixel" not in table:
        return table
    sensor = {name: value for name, value in table.pop("pixel").items() if value is not None}
    if "poles" in sensor:
        sensor["photoreceptor"] = "two_pole" if sensor.pop("poles") == 2 else "one_pole"
    if sensor["fill_factor"] == 1:
        del sensor["fill_factor"]  # which is unknown today
    sensor |= {name: table.pop(name) for name in ("width", "height", "threshold")}
    return {**table, "sensor": values_of(camera_of(sensor))}
