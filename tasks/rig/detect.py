"""Markers of a recording, in its frames or in images made of its events."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor import Events
from sensor.levels import DARK_SHARE
from tasks.errors import RigError
from tasks.exposures import FILE_NAME as FRAMES_TABLE
from tasks.methods.high_pass_filter import HighPassFilter
from tasks.rig.markers import Detections, Refinement, Source, detector, gray_codes
from tasks.rig.page import linear
from tasks.rig.recording import RigRecording, thresholds_of
from tasks.video import ImageTaker, VideoMethod

Float64 = NDArray[np.float64]
Pictures = Iterator[tuple[int, NDArray[Any]]]  # times, us, and images of codes or log light

_ANY_THRESHOLD = 1.0  # of the high-pass filter, whose images are stretched anyway


def detect(
    recording: RigRecording,
    source: Source,
    *,
    images: int = 20,
    max_speed_mps: float = math.inf,
    contrast_threshold: float | None = None,
    blur_px: float = 0.0,
    refinement: Refinement | None = None,
    on_progress: Progress = silent,
) -> Detections:
    """Find the markers in images of a recording, at times evenly spaced along the slider's travel.

    Parameters
    ----------
    source
        "frame" for the frames, "hf" for images of the high-pass filter, with the defaults of its
        authors, or "ei" for the first frame plus all events since.
    max_speed_mps
        Leave out times at which the slider is faster, m/s.
    contrast_threshold
        C for "ei", log units; by default the simulated sensor's.
    blur_px
        Standard deviation of the Gaussian blur of each image before detection, px; 0 is no blur.
        With it, the latency of "ei" images is the photoreceptor's mean delay: a corner is where the
        image is halfway between dark and light, which is the median delay after a sharp step, and
        the mean delay in an evenly blurred edge. The corners themselves get less exact. Frames are
        blurred in their codes, in which corners are located: blurred in light, an edge would move
        toward the dark.
    """
    page, camera = recording.page, recording.camera
    check_positive("images", images, RigError)
    if contrast_threshold is not None:
        check_positive("threshold", contrast_threshold, RigError)
    if not 0 <= blur_px < camera.width:
        raise RigError(f"blur: found {blur_px:g} px, expected 0 to the width, {camera.width} px")
    count = len(page.markers_m)
    finder = detector(page.dictionary, count, camera.width, refinement or "contour")
    if source != "hf" and not recording.frames:
        raise RigError(f"{recording.folder}: --source {source} needs frames.csv, which is missing")
    if source == "frame":
        pictures = _frames(recording, images, max_speed_mps)
    else:
        pictures = _from_events(recording, source, images, max_speed_mps, contrast_threshold)
    rows = []
    for k, (time_us, image) in enumerate(pictures):
        numbers, *others = finder.find(_codes(image, blur_px))
        rows.append((np.full(len(numbers), time_us, np.int64), numbers, *others))
        on_progress("detecting", k + 1, images)
    t_us, numbers, corners_px, scores = map(np.concatenate, zip(*rows, strict=True))
    if not len(t_us):
        raise RigError(
            f"{recording.folder}: none of {len(rows)} images shows a marker of {page.dictionary}"
        )
    return Detections(t_us, numbers, corners_px, scores, source)


def _codes(image: NDArray[Any], blur_px: float) -> NDArray[np.uint8]:
    """Blur an image, and stretch it to 8 bits unless it has them already."""
    if blur_px > 0:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    return image if image.dtype == np.uint8 else gray_codes(image)


def _frames(recording: RigRecording, images: int, max_speed_mps: float) -> Pictures:
    """Yield the slow frames that are nearest to times along the way; each once."""
    slider, frames = recording.slider, recording.frames
    t_us = np.array([frame.t_us for frame in frames])
    read = (t_us >= slider.t_us[0]) & (t_us <= slider.t_us[-1])
    usable = np.flatnonzero(read & (np.abs(slider.speed_mps(t_us)) <= max_speed_mps))
    if not usable.size:
        raise RigError(
            f"{recording.folder / FRAMES_TABLE}: has no frame within {slider.t_us[0]:.0f} to "
            f"{slider.t_us[-1]:.0f} us, the slider's readings, at up to --max-speed {max_speed_mps}"
        )
    taken_us = t_us[usable]
    wanted_us = slider.evenly_along(images, float(taken_us[0]), float(taken_us[-1]), max_speed_mps)
    nearest = np.unique(np.argmin(abs(taken_us[:, None] - wanted_us), axis=0))
    for k in usable[nearest].tolist():
        yield frames[k].t_us, frames[k].codes(recording.camera)


class _Integration:
    """Event integration: a first frame in log light, plus C of its polarity for each event since.

    After an event the light goes on in its direction, by C / 2 on average before the next one: that
    is added too, or edges would be late by the time in which they change the light by C / 2.
    """

    def __init__(self, log_frame: Float64, from_us: int, C_on: float, C_off: float) -> None:
        self._log_image, self._from_us, self._C = log_frame.copy(), from_us, (C_on, C_off)
        self._last = np.zeros(log_frame.shape)  # change of each pixel's light in its last event

    def push(self, events: Events) -> None:
        later = events[int(np.searchsorted(events.t_us, self._from_us)) :]
        if len(later):
            C_on, C_off = self._C
            changes = np.where(later.p > 0, C_on, -C_off)
            pixel = later.y.astype(np.int64) * later.width + later.x
            sums = np.bincount(pixel, changes, minlength=self._log_image.size)
            self._log_image += sums.reshape(self._log_image.shape)
            changed, from_end = np.unique(pixel[::-1], return_index=True)
            self._last.ravel()[changed] = changes[::-1][from_end]

    def image(self, t_us: int) -> Float64:
        return self._log_image + 0.5 * self._last


def _from_events(
    recording: RigRecording,
    source: Source,
    images: int,
    max_speed_mps: float,
    contrast_threshold: float | None,
) -> Pictures:
    """Yield images that are made of the events."""
    camera, (first_us, last_us) = recording.camera, recording.slider.t_us[[0, -1]].tolist()
    edges_us = [int(part.t_us[k]) for part in recording.events() if len(part) for k in (0, -1)]
    first_us, last_us = max(edges_us[0], first_us), min(edges_us[-1], last_us)
    method: VideoMethod
    if source == "hf":
        method = HighPassFilter(camera.width, camera.height, _ANY_THRESHOLD)
    else:
        thresholds = thresholds_of(recording.events_file, contrast_threshold)
        frame = recording.frames[0]
        light = linear(frame.codes(camera))
        method = _Integration(np.log(light + DARK_SHARE), frame.t_us, *thresholds)
        first_us = max(first_us, float(frame.t_us))
    wanted_us = recording.slider.evenly_along(images, first_us, last_us, max_speed_mps)
    taker = ImageTaker(method, wanted_us.tolist())
    for part in recording.events():
        yield from taker.take(part)
    yield from taker.rest()
