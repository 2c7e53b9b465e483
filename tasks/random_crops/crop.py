"""One random crop: what a small part of a sensor sees and reports, the truth, and samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sensor import Events, simulate
from sensor.representations import voxel_grid
from tasks.methods.our_reconstruction import InputGrids
from tasks.random_crops.motion import Motion
from tasks.random_crops.settings import CropLight, Crops
from tasks.random_crops.texture import random_texture, view
from tasks.video import picture

Float32 = NDArray[np.float32]

EQUALIZATION = "global"  # an area of 160 px is a tile of the local equalization at 1280 px

_HELD_OUT = 1 << 64  # larger than any seed


@dataclass(frozen=True, eq=False, slots=True)
class Crop:
    """A random crop.

    Parameters
    ----------
    events
        Events of each window, [start, end).
    ends_us
        Ends of the windows, us.
    texture
        What is seen, linear radiance.
    motion
        Motion of the texture, with time in windows.
    contrast_threshold
        C, log units.
    cutoff_hz
        Cutoff of the photoreceptor, Hz.
    dark_level
        Of the sensor.
    """

    events: tuple[Events, ...]
    ends_us: tuple[int, ...]
    texture: Float32
    motion: Motion
    contrast_threshold: float
    cutoff_hz: float
    dark_level: float

    def log_image(self, t: float, side_px: int) -> Float32:
        """Return what an ideal sensor sees at a time.

        Parameters
        ----------
        side_px
            Side of the image, px; it has the same middle as the crop.

        Returns
        -------
        (side_px, side_px) log intensity, including the dark level.
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

    Its texture, motion and contrast threshold do not depend on the light.

    Parameters
    ----------
    light
        "ideal", "all" to draw the cutoff, or the cutoff in Hz.
    held_out
        Whether the crop is one of those that no training sees, whatever its seed.
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

    def frames() -> Iterator[Float32]:
        for homography in motion.homographies(times):
            yield view(texture, homography, crops.side_px)

    camera = crops.camera.with_threshold(contrast_threshold)
    model = camera.model(cutoff_hz=cutoff_hz)
    window_s = 1e-3 * crops.window_ms
    events = simulate(frames(), window_s * times, model, seed=index, threads=1)
    bounds_us = [round(1e6 * window_s * k) for k in range(windows + 1)]
    in_windows = tuple(events.between(*window) for window in pairwise(bounds_us))
    levels = contrast_threshold, cutoff_hz, camera.dark_share
    return Crop(in_windows, tuple(bounds_us[1:]), texture, motion, *levels)


def _log_uniform(rng: np.random.Generator, between: tuple[float, float]) -> float:
    return math.exp(rng.uniform(math.log(between[0]), math.log(between[1])))


def _frame_times(motion: Motion, windows: int, max_displacement_px: float) -> NDArray[np.float64]:
    """Return times of frames, in windows: evenly spaced in each window, including both ends."""
    times = [np.zeros(1)]
    for k in range(windows):
        count = math.ceil(motion.fastest_px(k) / max_displacement_px)
        times.append(k + np.arange(1, count + 1) / count)
    return np.concatenate(times)


def video_sample(crop: Crop, bins: int, run_in: int, ranked_px: int) -> tuple[Float32, Float32]:
    """Return a sample of video reconstruction.

    Parameters
    ----------
    run_in
        Number of windows at the start that are left out; their events still enter the sums.
    ranked_px
        Side of the area with the same middle in which pixels are ranked, px; the crop's or larger.

    Returns
    -------
    grids
        (windows, bins + 4, S, S) inputs of the network.
    pictures
        (windows, S, S) true image at the end of each window, as the scorer shows it: the brightness
        of a pixel is its rank in an area around the crop, in [0, 1].
    """
    side_px = crop.events[0].width
    inputs = InputGrids(side_px, side_px, crop.contrast_threshold, bins)
    grids = [inputs.push(events) for events in crop.events]
    first = (ranked_px - side_px) // 2
    inside = slice(first, first + side_px)
    pictures = []
    for k in range(run_in + 1, len(crop.events) + 1):
        image = crop.log_image(k, ranked_px)
        pictures.append(picture(image, image.shape, EQUALIZATION)[inside, inside])
    return np.stack(grids[run_in:]), np.stack(pictures).astype(np.float32)


def flow_sample(crop: Crop, bins: int) -> tuple[Float32, Float32]:
    """Return a sample of dense flow: successive windows make a pair.

    Returns
    -------
    grids
        (pairs + 1, bins, S, S): a pair is a grid and the next one.
    flows
        (pairs, 2, S, S) px, from the start of the second window of a pair to its end.
    """
    grids = [voxel_grid(events, bins, convention="eraft") for events in crop.events]
    flows = [crop.motion.flow(k, k + 1) for k in range(1, len(grids))]
    return np.stack(grids), np.stack(flows)
