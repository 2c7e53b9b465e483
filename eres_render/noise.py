"""How noisy path-traced frames are, and what an event camera makes of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.frame_times import adaptive_times
from eres_render.render import Renderer

_CROP_PX, _PLACES = 128, 4  # how much of the image, and at how many times, noise is measured
_DARK_SHARE = 1e-3  # of white: keeps the logarithm of black pixels finite, as a sensor does
_LONGEST_STEP_S = 0.02  # from frame to frame, where the camera is slow
_PIXELS, _FRAMES, _SETTLING_FRAMES = 4000, 500, 1500


@dataclass(frozen=True, slots=True)
class Noise:
    """Monte Carlo noise of the log radiance of a pixel, standard deviations.

    Parameters
    ----------
    log_noise
        Of one frame.
    log_noise_step
        Of the change from one frame to the next, all frames with the same seed. With fresh seeds it
        would be `sqrt(2) * log_noise`; the less the camera moves the smaller it is.
    """

    log_noise: float
    log_noise_step: float

    def false_events_per_frame(self, contrast_threshold: float, fresh_seeds: bool = False) -> float:
        """Return the false events of one ideal pixel whose true light rests, per frame.

        Found by running the pixel on normal noise of this size, correlated from frame to frame as
        measured. It gives the order of magnitude, as real noise is uneven over the image and has
        long tails: against 250 rendered frames of fresh seeds at one pose, 0.25 for 0.14 events in
        a box room at 16 spp, 0.05 for 0.03 at 64 spp, and 1e-5 for 6e-5 at a grey and a mirror ball
        under a white sky.
        """
        kept = 1 - 0.5 * (self.log_noise_step / self.log_noise) ** 2 if self.log_noise > 0 else 1
        kept = 0.0 if fresh_seeds else float(np.clip(kept, 0.0, 1.0))
        renewed = math.sqrt(1 - kept**2)
        rng = np.random.default_rng(0)
        memory = rng.uniform(-contrast_threshold, contrast_threshold, _PIXELS)
        value = self.log_noise * rng.standard_normal(_PIXELS)
        events = 0.0
        for frame in range(_SETTLING_FRAMES + _FRAMES):
            steps = np.trunc((value - memory) / contrast_threshold)
            memory += contrast_threshold * steps
            if frame >= _SETTLING_FRAMES:
                events += float(abs(steps).sum())
            value = kept * value + renewed * self.log_noise * rng.standard_normal(_PIXELS)
        return events / (_PIXELS * _FRAMES)

    def describe(self, contrast_threshold: float = 0.2) -> str:
        """Return the noise and its false events in a sentence for people."""
        common, fresh = (
            self.false_events_per_frame(contrast_threshold, fresh_seeds=fresh)
            for fresh in (False, True)
        )
        return (
            f"log noise {self.log_noise:.2g} per pixel; at a contrast threshold of "
            f"{contrast_threshold:g} a pixel at rest fires about {common:.1g} false events a frame "
            f"({fresh:.1g} if frames did not share their random numbers)"
        )


def measure_noise(renderer: Renderer, max_displacement_px: float) -> Noise:
    """Measure a renderer's noise, at its resolution and samples per pixel.

    In the middle of the image, at a few times along the path, one pose is rendered twice with
    different seeds, and so is the next frame's: the difference of two seeds has no light in it,
    only noise, sqrt(2) times that of one frame.

    Parameters
    ----------
    max_displacement_px
        How far the image moves from frame to frame.
    """
    middle = renderer.at(crop_px=_CROP_PX)
    dark = _DARK_SHARE * renderer.white_level
    duration_s = renderer.scene.duration_s

    def difference(t_s: float) -> NDArray[np.float64]:
        pose = renderer.trajectory.pose(t_s)
        one, other = (
            np.log(middle.frame(pose, seed).astype(np.float64) + dark)
            for seed in (renderer.seed, renderer.seed + 1)
        )
        return one - other

    noise_squares, step_squares = [], []
    for k in range(_PLACES):
        start_s = (k + 0.5) / _PLACES * duration_s
        soon_s = min(start_s + _LONGEST_STEP_S, duration_s)
        t_s = adaptive_times(middle.image_motion, (start_s, soon_s), max_displacement_px)
        first, second = difference(t_s[0]), difference(t_s[1])
        noise_squares.append(0.5 * np.mean(first**2))
        step_squares.append(0.5 * np.mean((second - first) ** 2))
    return Noise(math.sqrt(np.mean(noise_squares)), math.sqrt(np.mean(step_squares)))
