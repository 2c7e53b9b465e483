"""Reference data from the frames and ground truth, shared by all sensors."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, GroundTruth, RadianceSequence
from sensor.model import SensorModel
from sensor.optics import integrate
from tasks.flow import Features, find_features
from tasks.reconstruction import log_white_level
from tasks.video import log_light, picture

_MOST_PICTURES = 16  # kept for the next sensor; 13 MB each at 1280 px


_T = TypeVar("_T")


class _CachedOnce(cached_property[_T]):
    """A cached property that one thread computes while the others wait, as before Python 3.12."""

    def __init__(self, compute: Callable[[Any], _T]) -> None:
        super().__init__(compute)
        self._lock = threading.RLock()

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> Any:
        with self._lock:
            return super().__get__(instance, owner)


class ReferenceFrames:
    """Frames, ground truth and log images of one sequence, to compare answers with.

    Parameters
    ----------
    sequence
        The frames.
    truth
        Poses, depth and flow of their scene.
    dark_level
        Dark level of the sensors, in the frames' unit of radiance.
    models
        Models of the sensors; those of one width have the same height and fill factor.
    """

    def __init__(
        self,
        sequence: RadianceSequence,
        truth: GroundTruth,
        dark_level: float,
        models: Iterable[SensorModel],
    ) -> None:
        self.sequence = sequence
        self.truth = truth
        self.dark_level = dark_level
        self._models = {model.width: model for model in models}
        self._features: dict[tuple[int, int], Features] = {}
        self._pictures: dict[tuple[float, str], NDArray[np.float64]] = {}
        self._picturing = threading.Lock()

    @_CachedOnce
    def start(self) -> NDArray[np.float32]:
        """(H, W) radiance at the window's start."""
        return self._frame_at(self.sequence.window_s[0])

    @_CachedOnce
    def end(self) -> NDArray[np.float32]:
        """(H, W) radiance at the window's end."""
        return self._frame_at(self.sequence.window_s[1])

    @_CachedOnce
    def log_start(self) -> NDArray[np.float64]:
        """(H, W) log intensity at the window's start."""
        return self.log(self.start)

    @_CachedOnce
    def log_end(self) -> NDArray[np.float64]:
        """(H, W) log intensity at the window's end."""
        return self.log(self.end)

    @_CachedOnce
    def log_white(self) -> float:
        """Log intensity of white at the window's end."""
        return log_white_level(self.log_end)

    @_CachedOnce
    def log_images(self) -> dict[int, NDArray[np.float64]]:
        """(h, w) log intensity at the window's start at each sensor's resolution, by its width."""
        return {
            width: self.log(integrate(self.start, model.height, width, model.fill_factor))
            for width, model in self._models.items()
        }

    def camera(self, width: int, height: int) -> Camera:
        """Return the camera of a sensor that sees all of the frames.

        Parameters
        ----------
        width, height
            Size of the sensor, px.

        Returns
        -------
        The camera, with its lens.
        """
        camera = self.truth.camera(width)
        # A narrow sensor of a shape that the frames only nearly have may be a pixel higher.
        return camera if camera.height == height else self.truth.camera(width, height)

    def features(self, count: int, seed: int) -> Features:
        """Return features at the window's start, in pixels of the frames.

        Parameters
        ----------
        count, seed
            As for `find_features`.

        Returns
        -------
        Features, the same for every sensor.
        """
        if (count, seed) not in self._features:
            manifest = self.sequence.manifest
            key = manifest.scene, manifest.clip
            self._features[count, seed] = find_features(
                self.start, self.truth, self.sequence.window_s, key, count=count, seed=seed
            )
        return self._features[count, seed]

    def picture(self, t_s: float, equalization: str) -> NDArray[np.float64]:
        """Return the true image to compare an image of a video with.

        Parameters
        ----------
        t_s
            Time of the image, seconds of the sequence.
        equalization
            As for `tasks.video.picture`.

        Returns
        -------
        (H, W) in [0, 1], at the frames' resolution.
        """
        key = t_s, equalization
        with self._picturing:  # sensors are scored by several threads
            if key not in self._pictures:
                log_image = log_light(self.sequence, t_s, self.dark_level)
                if len(self._pictures) >= _MOST_PICTURES:  # they ask for one time after another
                    del self._pictures[next(iter(self._pictures))]
                self._pictures[key] = picture(log_image, log_image.shape, equalization)
            return self._pictures[key]

    def log(self, radiance: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return log intensity with the sensors' dark level."""
        return np.log(radiance.astype(np.float64) + self.dark_level)

    def _frame_at(self, t_s: float) -> NDArray[np.float32]:
        return self.sequence.frame(int(np.searchsorted(self.sequence.t_s, t_s)))
