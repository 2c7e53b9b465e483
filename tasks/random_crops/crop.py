"""One random crop: what a small part of a sensor sees and reports, with the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sensor import Events, simulate
from tasks.random_crops.motion import Motion
from tasks.random_crops.settings import CropLight, Crops
from tasks.random_crops.texture import random_texture, view

_HELD_OUT = 1 << 64  # larger than any seed


@dataclass(frozen=True, eq=False, slots=True)
class Crop:
    """A random crop: events of each window, [start, end), and the light that caused them.

    `texture` is linear radiance, time in `motion` is in windows, and `contrast_threshold` is C in
    log units.
    """

    events: tuple[Events, ...]
    ends_us: tuple[int, ...]
    texture: NDArray[np.float32]
    motion: Motion
    contrast_threshold: float
    cutoff_hz: float
    dark_level: float

    def log_image(self, t: float, side_px: int) -> NDArray[np.float32]:
        """Return the log intensity, with the dark level, that an ideal sensor sees at a time.

        The time is in windows; the image, (side_px, side_px), has the same middle as the crop.
        """
        (homography,) = self.motion.homographies(np.array([t]), side_px)
        return np.log(view(self.texture, homography, side_px) + np.float32(self.dark_level))


def random_crop(
    crops: Crops,
    windows: int,
    seed: int,
    index: int,
    *,
    light: CropLight | float = "all",
    held_out: bool = False,
) -> Crop:
    """Make a crop, which depends only on the arguments.

    Its texture, motion and contrast threshold do not depend on the light: "ideal", "all" to draw
    the cutoff, or the cutoff in Hz. No training sees a crop that is held out, whatever its seed.
    """
    entropy = [_HELD_OUT, seed] if held_out else [seed]
    rng = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(index,)))
    contrast_threshold = _log_uniform(rng, crops.contrast_threshold)
    drawn_hz = _log_uniform(rng, crops.cutoff_hz)
    drawn_hz = math.inf if rng.random() < crops.ideal_share else drawn_hz
    cutoff_hz = {"ideal": math.inf, "all": drawn_hz}[light] if isinstance(light, str) else light
    texture = random_texture(rng, _log_uniform(rng, crops.log_contrast))
    motion_px = _log_uniform(rng, crops.motion_px)
    motion = Motion(rng, crops.side_px, motion_px, _log_uniform(rng, crops.texels_per_px))
    times = _frame_times(motion, windows, crops.max_displacement_px)

    frames = (view(texture, each, crops.side_px) for each in motion.homographies(times))
    camera = crops.camera.with_threshold(contrast_threshold)
    model = camera.model(cutoff_hz=cutoff_hz)
    window_s = 1e-3 * crops.window_ms
    events = simulate(frames, window_s * times, model, seed=index, threads=1)
    bounds_us = [round(1e6 * window_s * k) for k in range(windows + 1)]
    in_windows = tuple(events.between(*window) for window in pairwise(bounds_us))
    levels = contrast_threshold, cutoff_hz, camera.dark_share
    return Crop(in_windows, tuple(bounds_us[1:]), texture, motion, *levels)


def _log_uniform(rng: np.random.Generator, between: tuple[float, float]) -> float:
    return math.exp(rng.uniform(math.log(between[0]), math.log(between[1])))


def _frame_times(motion: Motion, windows: int, max_displacement_px: float) -> NDArray[np.float64]:
    """Return times of frames, in windows: evenly spaced in each window, including both ends."""
    counts = [math.ceil(motion.fastest_px(k) / max_displacement_px) for k in range(windows)]
    times = [k + np.arange(1, count + 1) / count for k, count in enumerate(counts)]
    return np.concatenate([np.zeros(1), *times])
