"""Markers of a recording, in its frames or in images made of its events; their corners in a file.

OpenCV puts (0, 0) at the center of the first pixel. Here it is at the pixel's corner, so half a
pixel is added, except to the AprilTag refinement, which counts from the corner already.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from eres_render.errors import check_positive, reading
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import write_bytes
from sensor import Events
from sensor.growth import check_growth
from sensor.levels import DARK_SHARE
from tasks.errors import RigError
from tasks.exposures import FILE_NAME as FRAMES_TABLE
from tasks.methods.high_pass_filter import HighPassFilter
from tasks.rig.page import linear, markers
from tasks.rig.recording import RigRecording, span_us, thresholds_of
from tasks.video import ImageTaker, VideoMethod

Float64 = NDArray[np.float64]
Pictures = Iterator[tuple[int, NDArray[Any]]]  # times, us, and images of codes or log light
Source = Literal["frame", "hf", "ei"]
Refinement = Literal["none", "subpix", "contour", "apriltag"]

_SMALL_PX = 640  # narrower images are enlarged, so that the markers' cells have enough pixels
_ENLARGED = 4
_PERCENTILES = (1.0, 99.0)  # black and white of a gray image
_ANY_THRESHOLD = 1.0  # of the high-pass filter, whose images are stretched anyway


@dataclass(frozen=True, eq=False, slots=True)
class Detections:
    """M markers in images.

    Times, (M,), are on the events' clock. Corners, (M, 4, 2), go clockwise from the marker's top
    left, px from the corner of the image. The score, (M,), is a marker's contrast: the standard
    deviation of its gray codes as a fraction of the largest possible. Images are from a frame
    camera ("frame"), the high-pass filter ("hf") or event integration ("ei").
    """

    t_us: NDArray[np.int64]
    number: NDArray[np.int64]
    corners_px: Float64
    score: Float64
    source: Source


def find_markers(
    gray: NDArray[np.uint8], dictionary: str, count: int, refinement: Refinement = "contour"
) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Find the markers in gray codes, (H, W): numbers, corners and scores as in `Detections`.

    Numbers ascend; a number seen twice, or not below `count`, is left out. With "contour", corners
    are intersections of lines fitted to the markers' sides. Images narrower than 640 px are
    enlarged.
    """
    times = _ENLARGED if gray.shape[1] < _SMALL_PX else 1
    large = cv2.resize(gray, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{refinement.upper()}")
    shift = 0.0 if refinement == "apriltag" else 0.5
    finder = cv2.aruco.ArucoDetector(markers(dictionary), parameters)
    quads, numbers, _ = finder.detectMarkers(large)
    number = np.asarray([] if numbers is None else numbers, np.int64).ravel()
    corners = np.asarray(quads, np.float64).reshape(-1, 4, 2)
    known, first, counts = np.unique(number, return_index=True, return_counts=True)
    once = (counts == 1) & (known < count)
    corners_px = (corners[first[once]] + shift) / times
    return known[once], corners_px, np.array([_contrast(gray, quad) for quad in corners_px])


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

    `contrast_threshold` is C for "ei", log units; by default the simulated sensor's. `blur_px` is
    the standard deviation of a Gaussian blur, with which the latency of "ei" images is the
    photoreceptor's mean delay. A corner is where the image is halfway between dark and light: that
    is the median delay after a sharp step, and the mean delay in an evenly blurred edge. Frames are
    blurred in their codes: blurred in light, an edge would move toward the dark.
    """
    page, camera = recording.page, recording.camera
    check_positive("images", images, RigError)
    if contrast_threshold is not None:
        check_positive("threshold", contrast_threshold, RigError)
    if not 0 <= blur_px < camera.width:
        raise RigError(f"blur: found {blur_px:g} px, expected 0 to the width, {camera.width} px")
    of_page = page.dictionary, len(page.markers_m), refinement or "contour"
    if source != "hf" and not recording.frames:
        raise RigError(f"{recording.folder}: --source {source} needs frames.csv, which is missing")
    if source == "frame":
        pictures = _frames(recording, images, max_speed_mps)
    else:
        pictures = _from_events(recording, source, images, max_speed_mps, contrast_threshold)
    rows = []
    for k, (time_us, image) in enumerate(pictures):
        if blur_px > 0:
            image = cv2.GaussianBlur(image, (0, 0), blur_px)
        gray = image if image.dtype == np.uint8 else gray_codes(image)
        numbers, *others = find_markers(gray, *of_page)
        rows.append((np.full(len(numbers), time_us, np.int64), numbers, *others))
        on_progress("detecting", k + 1, images)
    t_us, numbers, corners_px, scores = map(np.concatenate, zip(*rows, strict=True))
    if not len(t_us):
        raise RigError(
            f"{recording.folder}: none of {len(rows)} images shows a marker of {page.dictionary}"
        )
    return Detections(t_us, numbers, corners_px, scores, source)


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
        yield frames[k].t_us, recording.codes(frames[k])


class _Integration:
    """Event integration: a first frame in log light, plus C of its polarity for each event since.

    Half a threshold in the direction of each pixel's last event is added, or edges would be late.
    """

    def __init__(self, log_frame: Float64, from_us: int, C_on: float, C_off: float) -> None:
        self._log_image, self._from_us = log_frame.copy(), from_us
        self._changes = C_on, -C_off
        self._last = np.zeros(log_frame.shape)  # change of each pixel's light in its last event

    def push(self, events: Events) -> None:
        later = events[int(np.searchsorted(events.t_us, self._from_us)) :]
        changes = np.where(later.p > 0, *self._changes)
        pixel = later.y.astype(np.int64) * later.width + later.x
        sums = np.bincount(pixel, changes, minlength=self._log_image.size)
        self._log_image += sums.reshape(self._log_image.shape)
        self._last[later.y, later.x] = changes  # of several at a pixel, the last one stays

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
    camera, edges_us = recording.camera, span_us(recording.events_file, recording.events())
    first_us, last_us = recording.slider.t_us[[0, -1]].clip(*edges_us).tolist()
    method: VideoMethod
    if source == "hf":
        method = HighPassFilter(camera.width, camera.height, _ANY_THRESHOLD)
    else:
        thresholds = thresholds_of(recording.events_file, contrast_threshold)
        frame = recording.frames[0]
        log_frame = np.log(linear(recording.codes(frame)) + DARK_SHARE)
        method = _Integration(log_frame, frame.t_us, *thresholds)
        first_us = max(first_us, float(frame.t_us))
    wanted_us = recording.slider.evenly_along(images, first_us, last_us, max_speed_mps)
    taker = ImageTaker(method, wanted_us.tolist())
    for part in recording.events():
        yield from taker.take(part)
    yield from taker.rest()


def gray_codes(image: Float64) -> NDArray[np.uint8]:
    """Stretch an image of any range to 8 bits, from its 1st percentile to its 99th."""
    black, white = np.percentile(image, _PERCENTILES)
    if not white > black:
        return np.zeros(image.shape, np.uint8)
    return np.round(255 * np.clip((image - black) / (white - black), 0, 1)).astype(np.uint8)


def _contrast(gray: NDArray[np.uint8], corners_px: Float64) -> float:
    low = np.clip(np.floor(corners_px.min(axis=0)), 0, None).astype(int)
    high = np.ceil(corners_px.max(axis=0)).astype(int)
    part = gray[low[1] : high[1], low[0] : high[0]]
    return float(part.std() / 127.5) if part.size else 0.0


def write_detections(path: Path, detections: Detections, *, overwrite: bool = True) -> None:
    """Write a Parquet row per corner: t_us, id, corner (0 to 3), u_px, v_px, score and source."""
    import pyarrow as pa  # here, as it loads slowly
    import pyarrow.parquet as pq

    count = len(detections.t_us)
    table = pa.table(
        {
            "t_us": np.repeat(detections.t_us, 4),
            "id": np.repeat(detections.number, 4),
            "corner": np.tile(np.arange(4), count),
            "u_px": detections.corners_px[..., 0].ravel(),
            "v_px": detections.corners_px[..., 1].ravel(),
            "score": np.repeat(detections.score, 4),
            "source": pa.array([detections.source] * (4 * count), pa.string()),
        }
    )
    data = pa.BufferOutputStream()
    pq.write_table(table, data, compression="zstd")
    write_bytes(path, data.getvalue().to_pybytes(), overwrite=overwrite)


def read_detections(path: Path) -> Detections:
    """Read the markers that `write_detections` wrote."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    names = ["t_us", "id", "u_px", "v_px", "score", "source"]
    with reading(path, "a file of `eres rig detect`", RigError):
        data = path.read_bytes()
        file = pq.ParquetFile(pa.BufferReader(data))
        check_growth(8 * file.metadata.num_rows * file.metadata.num_columns, len(data))
        table = file.read(columns=names)
        t_us, numbers, u_px, v_px, scores, sources = (table[name].to_numpy() for name in names)
        return Detections(
            t_us=t_us[::4].astype(np.int64),
            number=numbers[::4].astype(np.int64),
            corners_px=np.stack([u_px, v_px], axis=-1).reshape(-1, 4, 2).astype(np.float64),
            score=scores[::4].astype(np.float64),
            source=sources[0],
        )
