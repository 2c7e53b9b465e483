"""Images of a frame camera at the place of the event camera: exposure, noise, encoding."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from eres_render import RadianceSequence
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import new_file, write_text
from eres_render.storage.json_values import json_values
from sensor.encoding import to_srgb
from tasks.errors import TaskError
from tasks.events.frame_camera_options import FrameCameraOptions
from tasks.exposures import FILE_NAME as FRAMES_TABLE
from tasks.exposures import Exposure, write_exposures

Float64 = NDArray[np.float64]

_MAX_DRAWN = 1e18  # that NumPy draws; far above every full well

FILE_NAME = "images.json"
_IN_USE = "[0-9]" * 6 + ".png", FILE_NAME, FRAMES_TABLE, "manifest.json"


def write_images(
    sequence: RadianceSequence,
    out: str | Path,
    rate_hz: float,
    options: FrameCameraOptions,
    *,
    speed: float = 1.0,
    seed: int = 0,
    on_progress: Progress = silent,
) -> int:
    """Write the images that a frame camera takes along a sequence.

    Writes `000000.png`, ..., 8-bit gray encoded as sRGB, with white at the sequence's white level;
    `frames.csv`: the start and end of each exposure, microseconds on the clock of the events, as
    `tasks.recording.frames` reads them; and finally `images.json`: the same and the options.

    Parameters
    ----------
    sequence
        The sequence.
    out
        Folder of the images; made if it does not exist.
    rate_hz
        Images per second of the events' time. The first exposure starts with the sequence, the last
        ends within it.
    options
        The camera; its exposure is in the events' time.
    speed
        Factor by which the scene moves faster than it was rendered.
    seed
        Seed of the noise.
    on_progress
        Called after each image.

    Returns
    -------
    count
        Number of images.

    Raises
    ------
    TaskError
        A value is out of range, the exposure does not fit, or the folder holds images.
    """
    out = Path(out)
    options.check()
    check_positive("speed", speed, TaskError, "a positive factor")
    if not 0 < rate_hz * options.exposure <= 1:
        asked = f"rate, exposure: found {rate_hz:g} Hz and {options.exposure:g} s"
        raise TaskError(f"{asked}, expected a rate above 0 and exposures that do not overlap")
    if seed < 0:
        raise TaskError(f"seed: found {seed}, expected 0 or more")
    if out.exists() and not out.is_dir():
        raise TaskError(f"{out}: found a file, expected a folder")
    for file in (file for name in _IN_USE for file in out.glob(name)):
        raise TaskError(f"{out}: contains {file.name} already; choose another folder")
    t_s = sequence.t_s / speed
    room_s = float(t_s[-1] - t_s[0]) - options.exposure
    if room_s < -1e-9:
        length = f"{t_s[-1] - t_s[0]:g} s, the length of the sequence at speed {speed:g}"
        raise TaskError(f"exposure: found {options.exposure:g} s, expected at most {length}")
    starts_s = t_s[0] + np.arange(math.floor(room_s * rate_hz + 1e-9) + 1) / rate_hz
    rng = np.random.default_rng(seed)
    for k, start_s in enumerate(starts_s.tolist()):
        end_s = start_s + options.exposure
        light = exposed(sequence, start_s * speed, end_s * speed) / sequence.white_level
        with new_file(out / f"{k:06d}.png") as file:
            Image.fromarray(developed(light, options, rng)).save(file, "PNG")
        on_progress("images", k + 1, len(starts_s))
    edges_us = np.round(1e6 * np.stack([starts_s, starts_s + options.exposure], axis=1))
    exposures_us = (sequence.t_offset_us + edges_us.astype(np.int64)).tolist()
    images = [Exposure(first, last, f"{k:06d}.png") for k, (first, last) in enumerate(exposures_us)]
    write_exposures(out, images)
    facts = {
        "exposures_us": exposures_us,
        "rate_hz": float(rate_hz),
        "speed": float(speed),
        "white_level": sequence.white_level,
        "seed": int(seed),
        **json_values(options),
    }
    write_text(out / FILE_NAME, json.dumps(facts, indent=1) + "\n")
    return len(starts_s)


def exposed(sequence: RadianceSequence, start_s: float, end_s: float) -> Float64:
    """Return the mean radiance of an exposure; between frames radiance is linear in time.

    Parameters
    ----------
    sequence
        The sequence.
    start_s, end_s
        Start and end of the exposure, seconds in the time of the frames.

    Returns
    -------
    radiance
        (H, W).
    """
    first, weights = frame_weights(sequence.t_s, start_s, end_s)
    radiance = np.zeros(sequence.frame(first).shape)
    for k, weight in enumerate(weights.tolist()):  # an exposure may have hundreds of frames
        radiance += weight * sequence.frame(first + k)
    return radiance


def frame_weights(t_s: Float64, start_s: float, end_s: float) -> tuple[int, Float64]:
    """Return the weights of frames in their mean over an interval of time.

    Parameters
    ----------
    t_s
        (T,) increasing times of the frames, s.
    start_s, end_s
        Start and end of the interval, s, within these times.

    Returns
    -------
    first
        Index of the first frame with a weight.
    weights
        (N,) weights of the frames from `first` on; their sum is 1.
    """
    first = max(0, int(np.searchsorted(t_s, start_s, "right")) - 1)
    stop = min(len(t_s), int(np.searchsorted(t_s, end_s, "left")) + 1)
    t = t_s[first:stop]
    low, high = np.maximum(t[:-1], start_s), np.minimum(t[1:], end_s)
    share = (0.5 * (low + high) - t[:-1]) / np.diff(t)  # of the later frame
    weights = np.append((high - low) * (1 - share), 0.0)
    weights[1:] += (high - low) * share
    return first, weights / weights.sum()


def developed(
    light: Float64, options: FrameCameraOptions, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return the image of an exposure: electrons with noise, then 8-bit sRGB.

    Parameters
    ----------
    light
        (H, W) mean light of the exposure; 1 fills a pixel's well.
    options
        The camera.
    rng
        Source of the noise.

    Returns
    -------
    image
        (H, W) codes from 0 to 255.
    """
    if options.full_well < math.inf:
        mean = np.minimum(options.full_well * light, _MAX_DRAWN)
        electrons = rng.poisson(mean).astype(np.float64)
        electrons += options.read_noise * rng.standard_normal(light.shape)
        light = electrons / options.full_well
    return np.round(255 * to_srgb(np.clip(light, 0.0, 1.0))).astype(np.uint8)
