"""Reference data from the frames and ground truth, shared by all sensors of a shape."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, GroundTruth, RadianceSequence
from sensor.model import SensorModel
from sensor.optics import crop_to_aspect, integrate
from tasks.flow import Features, find_features
from tasks.reconstruction import log_white_level
from tasks.video import log_light, picture

_MAX_PICTURES = 16  # for other sensors, which ask for one after another; 13 MB each at 1280 px

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class _CentralPart(RadianceSequence):
    """A sequence that crops the frames of another, which may still be rendering."""

    whole: RadianceSequence
    rows: slice
    columns: slice

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        return (frame[self.rows, self.columns] for frame in self.whole)

    def frame(self, i: int) -> NDArray[np.float32]:
        """Read frame i: (H, W) float32 linear radiance."""
        return self.whole.frame(i)[self.rows, self.columns]


def central_part(
    sequence: RadianceSequence, truth: GroundTruth, width: int, height: int
) -> tuple[RadianceSequence, GroundTruth]:
    """Return the largest central part of a sequence with the shape of a sensor, and its truth.

    The truth is of the cropped camera. If the sensor sees all, both are the arguments themselves.
    """
    whole = sequence.camera
    if height == round(width * whole.height / whole.width):  # its pixels may not be quite square
        return sequence, truth
    rows, columns = crop_to_aspect(whole.height, whole.width, height, width)
    size = columns.stop - columns.start, rows.stop - rows.start
    camera = whole.cropped(columns.start, rows.start, *size)
    values = {f.name: getattr(sequence, f.name) for f in fields(RadianceSequence)}
    values["manifest"] = replace(
        sequence.manifest,
        width=camera.width,
        height=camera.height,
        fov_rad=camera.fov_rad,
        intrinsics=(camera.fx, camera.fy, camera.cx, camera.cy),
    )
    part = _CentralPart(**values, whole=sequence, rows=rows, columns=columns)
    return part, truth.of_camera(camera)


class ReferenceFrames:
    """Frames, ground truth and log images of one sequence, to compare answers with.

    Log images have the dark level of a sensor. Each is computed once for all sensors that share it.
    """

    def __init__(self, sequence: RadianceSequence, truth: GroundTruth) -> None:
        self.sequence = sequence
        self.truth = truth
        self._computed: dict[tuple[object, ...], Any] = {}
        self._computing = threading.RLock()
        self._picture = lru_cache(maxsize=_MAX_PICTURES)(partial(_picture, sequence))
        self._picturing = threading.Lock()

    def _frame(self, end: int) -> NDArray[np.float32]:
        """(H, W) radiance at the window's start, 0, or at its end, 1."""
        k = int(np.searchsorted(self.sequence.t_s, self.sequence.window_s[end]))
        return self._once(("frame", k), lambda: self.sequence.frame(k))

    def log_frame(self, end: int, model: SensorModel) -> NDArray[np.float64]:
        """(H, W) log intensity at the window's start, 0, or end, 1, with a sensor's dark level."""
        return self._once(("log", end, model.dark_level), lambda: _log(self._frame(end), model))

    def log_white(self, model: SensorModel) -> float:
        """Log intensity of white at the window's end, with the dark level of a sensor."""
        key = "log_white", model.dark_level
        return self._once(key, lambda: log_white_level(self.log_frame(1, model)))

    def log_image(self, model: SensorModel) -> NDArray[np.float64]:
        """(h, w) log intensity at the window's start, as the pixels of a sensor see it."""
        pixels = model.height, model.width, model.fill_factor
        key = "log_image", *pixels, model.dark_level
        return self._once(key, lambda: _log(integrate(self._frame(0), *pixels), model))

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera of a sensor that sees all of the frames."""
        camera = self.truth.camera(width)
        # A narrow sensor of a shape that the frames only nearly have may be a pixel higher.
        return camera if camera.height == height else self.truth.camera(width, height)

    def features(self, count: int, seed: int) -> Features:
        """Return features at the window's start, in pixels of the frames."""
        key = self.sequence.manifest.scene, self.sequence.manifest.clip
        inputs = self._frame(0), self.truth, self.sequence.window_s, key
        return self._once(
            ("features", count, seed), lambda: find_features(*inputs, count=count, seed=seed)
        )

    def picture(self, model: SensorModel, t_s: float, equalization: str) -> NDArray[np.float64]:
        """Return the true image at a time of the sequence: (H, W) as the frames, in [0, 1]."""
        with self._picturing:  # sensors are scored by several threads
            return self._picture(model.dark_level or 0.0, t_s, equalization)

    def _once(self, key: tuple[object, ...], compute: Callable[[], _T]) -> _T:
        """Return what one thread computes while the others wait."""
        with self._computing:
            if key not in self._computed:
                self._computed[key] = compute()
            return self._computed[key]


def _log(radiance: NDArray[np.floating], model: SensorModel) -> NDArray[np.float64]:
    return np.log(radiance.astype(np.float64) + (model.dark_level or 0.0))


def _picture(
    sequence: RadianceSequence, dark_level: float, t_s: float, equalization: str
) -> NDArray[np.float64]:
    log_image = log_light(sequence, t_s, dark_level)
    return picture(log_image, log_image.shape, equalization)
