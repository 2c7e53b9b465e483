"""The reference that all sensors before the same frames share."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eres_render import GroundTruth, RadianceSequence
from sensor.optics import integrate
from tasks.evaluation.settings import Evaluate
from tasks.flow import Features, find_features
from tasks.reconstruction import log_white_level
from tasks.video import log_light, picture


class ReferenceFrames:
    """Frames, ground truth and log images of one sequence, the reference for methods' answers.

    Parameters
    ----------
    sequence
        The frames.
    truth
        Poses, depth and flow of their scene.
    evaluate
        Settings of the tasks.
    dark_level
        Dark level of the sensors, in the frames' unit of radiance.
    widths
        Widths of the sensors, px.
    """

    def __init__(
        self,
        sequence: RadianceSequence,
        truth: GroundTruth,
        evaluate: Evaluate,
        dark_level: float,
        widths: Iterable[int],
    ) -> None:
        self.sequence = sequence
        self.truth = truth
        self.evaluate = evaluate
        self.dark_level = dark_level
        self.widths = tuple(dict.fromkeys(widths))
        self._pictures: dict[float, NDArray[np.float64]] = {}

    @cached_property
    def start(self) -> NDArray[np.float32]:
        """(H, W) radiance at the window's start."""
        return self._frame_at(self.sequence.window_s[0])

    @cached_property
    def end(self) -> NDArray[np.float32]:
        """(H, W) radiance at the window's end."""
        return self._frame_at(self.sequence.window_s[1])

    @cached_property
    def log_start(self) -> NDArray[np.float64]:
        """(H, W) log intensity at the window's start."""
        return self.log(self.start)

    @cached_property
    def log_end(self) -> NDArray[np.float64]:
        """(H, W) log intensity at the window's end."""
        return self.log(self.end)

    @cached_property
    def log_white(self) -> float:
        """Log intensity of white at the window's end."""
        return log_white_level(self.log_end)

    @cached_property
    def log_images(self) -> dict[int, NDArray[np.float64]]:
        """Log intensity at the window's start as each sensor's pixels see it, by sensor width."""
        sizes = {width: (self.truth.camera(width).height, width) for width in self.widths}
        seen = {width: integrate(self.start, *size) for width, size in sizes.items()}
        return {width: self.log(image) for width, image in seen.items() if image is not None}

    @cached_property
    def features(self) -> Features:
        """Features at the window's start, in pixels of the frames."""
        config, manifest = self.evaluate.flow, self.sequence.manifest
        return find_features(
            self.start,
            self.truth,
            self.sequence.window_s,
            (manifest.scene, manifest.clip),
            count=config.features,
            seed=config.seed,
        )

    @cached_property
    def video_times_s(self) -> tuple[float, ...]:
        """Times at which images of a video are compared: every `every_s`, and the window's end."""
        start_s, end_s = self.sequence.window_s
        every_s = self.evaluate.video.every_s
        count = round((end_s - start_s) / every_s)
        return tuple(np.linspace(start_s, end_s, count + 1)[1:].tolist())

    def video_picture(self, t_s: float) -> NDArray[np.float64]:
        """Return the image that the image of a video at a time is compared with."""
        if t_s not in self._pictures:
            log_image = log_light(self.sequence, t_s, self.dark_level)
            equalisation = self.evaluate.video.equalisation
            self._pictures[t_s] = picture(log_image, log_image.shape, equalisation)
        return self._pictures[t_s]

    def log(self, radiance: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return the log intensity with the sensors' dark level."""
        return np.log(radiance.astype(np.float64) + self.dark_level)

    def _frame_at(self, t_s: float) -> NDArray[np.float32]:
        return self.sequence.frame(int(np.searchsorted(self.sequence.t_s, t_s)))
