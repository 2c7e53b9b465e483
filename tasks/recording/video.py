"""A recording's events as images: PNG files with their times."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from eres_render.errors import reading
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import clear_unfinished, make_folder, unfinished
from tasks.errors import TaskError
from tasks.evaluation.answers import ask, ask_each, image_answer
from tasks.methods import check_method, load_method
from tasks.methods.e2vid import even_window_us
from tasks.recording.options import VideoOptions
from tasks.recording.recording import Recording
from tasks.recording.threshold import ANY_THRESHOLDS, stored_thresholds
from tasks.registry import TASKS
from tasks.video import EQUALIZATIONS, ImageTaker, picture

TIMES = "timestamps.txt"
_MAX_IMAGES = 10**6
_NAMES = "fx fy cx cy k1 k2 p1 p2 k3 (k3 is optional; fx and fy are above 0)"
_FARTHEST = 0.2  # distance of the principal point from the middle, in widths and heights


class Calibration(NamedTuple):
    """A pinhole camera with distortion, as OpenCV has it.

    Parameters
    ----------
    K
        (3, 3) camera matrix, px; (0, 0) is the center of the top-left pixel.
    distortion
        (5,) k1, k2, p1, p2 and k3.
    """

    K: NDArray[np.float64]
    distortion: NDArray[np.float64]


def read_calibration(path: str | Path, size: tuple[int, int]) -> Calibration:
    """Read the lens of a camera, from a file as in the RPG's event camera dataset.

    Parameters
    ----------
    path
        The file: one line `fx fy cx cy k1 k2 p1 p2 k3`, in pixels.
    size
        Width and height of the sensor, px.

    Returns
    -------
    Calibration

    Raises
    ------
    TaskError
        The numbers are not as many, not finite or not of this sensor.
    """
    with reading(Path(path), "text", TaskError):
        text = Path(path).read_text(encoding="utf-8", errors="replace").split()
    try:
        numbers = np.array([float(word) for word in text])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) not in (8, 9) or not np.isfinite(numbers).all() or min(numbers[:2]) <= 0:
        raise TaskError(f"{path}: found {len(text)} words, expected the finite numbers {_NAMES}")
    for name, center, side in zip(("cx", "cy"), numbers[2:4], size, strict=True):
        middle = (side - 1) / 2
        if abs(center - middle) > _FARTHEST * side:
            sensor = f"{middle:g} px, the middle of the {size[0]}x{size[1]} sensor"
            raise TaskError(f"{path}, {name}: found {center:g} px, expected about {sensor}")
    fx, fy, cx, cy = numbers[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Calibration(K, np.resize(np.append(numbers[4:], 0.0), 5))


def image_times_us(recording: Recording, options: VideoOptions) -> list[int]:
    """Return the times of the images.

    Parameters
    ----------
    recording, options
        The events, and the images to make.

    Returns
    -------
    Times, us.

    Raises
    ------
    TaskError
        The rate is not positive or above 1e6 Hz, a time is not finite, the end is before the start,
        there are more than a million images, or there is none.
    """
    fps, start_s, end_s = options.fps, options.start, options.end
    if not 0 < fps <= 1e6:
        raise TaskError(f"--fps: found {fps:.16g}, expected above 0 and at most 1e6")
    step_us = 1e6 / fps
    start_us = recording.start_us + step_us if start_s is None else 1e6 * start_s
    end_us = recording.end_us if end_s is None else 1e6 * end_s
    if not math.isfinite(end_us - start_us) or (start_s is not None and end_us < start_us):
        span = f"{1e-6 * start_us:.12g} to {1e-6 * end_us:.12g} s"
        raise TaskError(f"--start, --end: found {span}, expected finite times, the start first")
    count = math.floor((end_us - start_us) / step_us + 1e-9) + 1
    if count < 1:
        span = f"{1e-6 * recording.start_us:.6f} to {1e-6 * recording.end_us:.6f} s"
        raise TaskError(f"{recording.path}: no image at {fps:g} Hz from {span}; raise --fps")
    if count > _MAX_IMAGES:
        raise TaskError(f"found {count} images, expected at most {_MAX_IMAGES}; lower --fps")
    return [round(start_us + k * step_us) for k in range(count)]


def network_options(name: str, times_us: Sequence[int]) -> dict[str, float]:
    """Return additional arguments for a method of task `video`.

    Parameters
    ----------
    name
        Name of the method.
    times_us
        Times of the images, us, ascending.

    Returns
    -------
    For a network, windows of which a whole number fits into the median time between images.
    """
    if name not in TASKS["video"].networks or len(times_us) < 2:
        return {}
    return {"window_us": even_window_us(float(np.median(np.diff(times_us))))}


def write_video(
    recording: Recording,
    out: str | Path,
    options: VideoOptions,
    *,
    contrast_threshold: float | None = None,
    calibration: Calibration | None = None,
    weights: Mapping[str, str] | None = None,
    overwrite: bool = False,
    on_progress: Progress = silent,
) -> int:
    """Write images of a recording to a folder, which appears when it is complete.

    Parameters
    ----------
    recording
        The events; a part of them is in memory at a time.
    out
        The folder: 000000.png and so on, and timestamps.txt with a time for each, us.
    options
        The images to make.
    contrast_threshold
        C, log units, by which methods scale log intensity; by default that of the sensor in the
        file, or 0.2.
    calibration
        Lens, whose distortion is removed from the images.
    weights
        Files of weights by the names of the methods that need them.
    overwrite
        Whether to replace a folder of such images.
    on_progress
        Called after each part of the events.

    Returns
    -------
    Number of images.

    Raises
    ------
    TaskError
        An option is out of range, or the folder exists.
    """
    out, name = Path(out).resolve(), options.method
    check_method("video", name, weights, [recording.size])
    if TASKS["video"].method(name).role == "diagnostic":
        raise TaskError(f"method: {name!r} needs the true light; choose another")
    known, wanted = ("none", *EQUALIZATIONS), options.equalization
    if wanted not in known:
        raise TaskError(f"equalization: found {wanted!r}, expected one of {', '.join(known)}")
    clear_unfinished(out.parent, out.name)
    _check_folder(out, overwrite)
    times_us = image_times_us(recording, options)
    start: Any = load_method("video", name, weights)
    if contrast_threshold is None:
        contrast_threshold = (stored_thresholds(recording) or ANY_THRESHOLDS).mean
    more = network_options(name, times_us)
    method, _ = ask("video", name, start, *recording.size, contrast_threshold, **more)
    taker = ImageTaker(method, times_us)
    make_folder(out.parent)
    with unfinished(out, folder=True) as folder:
        for k, log_image in enumerate(_images(recording, name, taker, on_progress)):
            codes = np.round(255 * picture(log_image, log_image.shape, wanted)).astype(np.uint8)
            if calibration is not None:
                codes = np.asarray(cv2.undistort(codes, *calibration), np.uint8)
            Image.fromarray(codes).save(folder / f"{k:06}.png")
        lines = "# unit: us", *map(str, times_us), ""
        (folder / TIMES).write_text("\n".join(lines), encoding="utf-8")
        _check_folder(out, overwrite)  # again: one may have appeared meanwhile
        if out.exists():  # it may be a mount point, or the folder in which a shell is
            for file in out.iterdir():
                file.unlink()
            for file in sorted(folder.iterdir(), key=lambda file: file.name == TIMES):
                shutil.move(file, out / file.name)
        else:
            folder.rename(out)
    return len(times_us)


def _check_folder(out: Path, overwrite: bool) -> None:
    if not out.exists():
        return
    if not out.is_dir():
        raise TaskError(f"{out}: is a file, expected a folder")
    files = sorted(out.iterdir())
    for file in files:
        if not (file.name == TIMES or (file.suffix == ".png" and file.stem.isdigit())):
            raise TaskError(f"{out}: contains {file.name}, expected only images and {TIMES}")
    if files and not overwrite:
        raise TaskError(f"{out}: already exists; add --overwrite to replace it")


def _images(
    recording: Recording, name: str, taker: ImageTaker, on_progress: Progress
) -> Iterator[NDArray[np.floating]]:
    blank = np.zeros(recording.size[::-1])
    parts = ((taker.take, events) for events in recording.counted("images", on_progress))
    calls: Iterable[tuple[Any, ...]] = chain(parts, [(taker.rest,)])
    for taken, _ in chain.from_iterable(ask_each("video", name, *call) for call in calls):
        if taken is not None:
            t_us, answer = taken
            image, failure = image_answer("video", name, answer, blank)
            if failure:
                raise TaskError(f"video, method {name!r}: image at {t_us} us: {failure}")
            yield image
