"""The noise of path-traced frames, and the events that it causes in an event camera."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eres_render.errors import RenderError, check_positive
from eres_render.rendering.renderer import Renderer
from eres_render.sequence.clips import Clip
from eres_render.trajectory.frame_times import adaptive_times

Float64 = NDArray[np.float64]

_log = logging.getLogger(__name__)

REPEATS = 64  # the reference has this many times the samples
_DARK_FRACTION = 1e-3  # of white, added before the logarithm: the sensor's default
_STRETCHES, _MAX_STRETCH_S = 4, 0.25
_MAX_PIXELS, _MIN_PIXELS = 256, 16  # of each stretch
_SHARE_OF_RENDER = 0.05  # largest cost of measuring, in samples
_FEW_SECONDS, _FEW_SECONDS_SCALAR = 8_000_000, 1_000_000  # samples that are always allowed


@dataclass(frozen=True, slots=True)
class Noise:
    """Measured Monte Carlo noise of rendered pixels, and the events that it causes.

    Parameters
    ----------
    log_noise
        Standard deviation of a pixel's log radiance, root mean square over pixels and frames.
    contrast_threshold
        Threshold of the ideal pixel that sees the frames. It has the size of a pixel of the render.
    events_hz
        Its event rate.
    false_events_hz
        Excess of that rate over the rate at `REPEATS` times the samples per pixel, where the same
        light has less noise. Noise adds and removes events; this is the difference.
    false_events_error_hz
        Standard error of the excess, from the choice of pixels.
    log_noise_of_quarter
        `log_noise` at `REPEATS / 4` times the samples. It is a quarter of `log_noise` if errors
        average out.

    Examples
    --------
    Light that was baked has no noise; path-traced light has:

    >>> from eres_render import Clip, Renderer, load_scene, measure_noise
    >>> renderer = Renderer(load_scene("carpet"), width=64, spp=16, integrator="path")
    >>> noise = measure_noise(renderer, [Clip(0, 0.24, 0.25, 0.26)], 0.5)
    >>> noise.log_noise > 0.01, noise.averages_out
    (True, True)
    """

    log_noise: float
    contrast_threshold: float
    events_hz: float
    false_events_hz: float
    false_events_error_hz: float
    log_noise_of_quarter: float

    @property
    def averages_out(self) -> bool:
        """Whether 16 times the samples at least halve the noise.

        If not, rare paths carry much of the light. Most renders miss them, and with more samples
        they appear as noise and can cause more events. So there is no reference for events.
        """
        return self.log_noise_of_quarter <= 0.5 * self.log_noise

    def describe(self) -> str:
        """Return the noise and its events as a sentence."""
        noise = f"log noise {self.log_noise:.2g} per pixel (rms)"
        fired = (
            f"an ideal pixel with a contrast threshold of {self.contrast_threshold:g} fires "
            f"{self.events_hz:.3g} events per second"
        )
        if not self.averages_out:
            of_mean_hz = self.events_hz - self.false_events_hz
            return (
                f"{noise}, and still {self.log_noise_of_quarter:.2g} with {REPEATS // 4} times the "
                f"samples, as rare paths carry much of the light; {fired}, and {of_mean_hz:.3g} "
                f"with {REPEATS} times the samples: how many are false is unknown"
            )
        false = f"{self.false_events_hz:.2g} ± {self.false_events_error_hz:.1g}"
        return (
            f"{noise}; {fired}, of which {false} are false, "
            f"as they are absent with {REPEATS} times the samples"
        )


def warn_of_noise(renderer: Renderer, clips: Sequence[Clip], max_displacement_px: float) -> None:
    """Warn how noisy the frames are if they are path-traced; see `measure_noise`."""
    if renderer.integrator == "path":
        noise = measure_noise(renderer, clips, max_displacement_px)
        name, spp = renderer.scene.name, renderer.spp
        _log.warning("%s is path-traced at %d spp: %s", name, spp, noise.describe())


class Comparators:
    """Ideal pixels that count their `events`, in the shape of the frames.

    Between frames log radiance is linear in time. A pixel fires whenever it is `contrast_threshold`
    away from its memory, which then moves by that much. The memory starts at the first frame.
    """

    def __init__(self, log_radiance: Float64, contrast_threshold: float) -> None:
        self._memory = log_radiance.copy()
        self._threshold = contrast_threshold
        self.events = np.zeros(log_radiance.shape, np.int64)

    def see(self, log_radiance: Float64) -> None:
        """Take the next frame; the first frame changes nothing."""
        crossed = np.trunc((log_radiance - self._memory) / self._threshold)
        self._memory += self._threshold * crossed
        self.events += np.abs(crossed).astype(np.int64)


def count_events(
    frames: Iterable[NDArray[np.floating]], dark_level: float, contrast_threshold: float
) -> tuple[Float64, Float64, Float64]:
    """Return mean event counts of R renders, counts of their mean, and variances of log radiance.

    Each frame is (R, N): N pixels in R renders with independent noise, R a multiple of 4.
    `dark_level` is added to the radiance, W m^-2 sr^-1. Counts are (N,). The variances, means over
    pixels and frames, are of one render and of the mean of a quarter of the renders.
    """
    pixels: list[Comparators] = []
    variances = []
    for frame in frames:
        radiance = np.asarray(frame, np.float64) + dark_level
        quarters = radiance.reshape(4, -1, radiance.shape[1]).mean(axis=1)
        views = np.log(radiance), np.log(quarters.mean(axis=0, keepdims=True))
        parts = views[0], np.log(quarters)
        variances.append([part.var(axis=0, ddof=1).mean() for part in parts])
        pixels = pixels or [Comparators(view, contrast_threshold) for view in views]
        for comparators, view in zip(pixels, views, strict=True):
            comparators.see(view)
    of_each, of_mean = (comparators.events.mean(axis=0) for comparators in pixels)
    return of_each, of_mean, np.mean(variances, axis=0)


def measure_noise(
    renderer: Renderer,
    clips: Sequence[Clip],
    max_displacement_px: float,
    contrast_threshold: float = 0.2,
) -> Noise:
    """Measure the noise of clips that are to be rendered, and the events that it causes.

    A few random pixels are rendered in all frames of up to four stretches of at most 0.25 s, spread
    evenly over the clips: `REPEATS` times, with different random numbers. Ideal pixels then see
    each of these renders, and their mean. The cost is at most a twentieth of the samples of the
    clips, or a few seconds if that is more, but at least 16 pixels are measured.

    Parameters
    ----------
    renderer
        Renders the clips.
    clips
        One or more clips.
    max_displacement_px
        Largest motion from frame to frame, px.
    contrast_threshold
        Threshold of the pixels that see the frames.

    Returns
    -------
    noise
        Measured over all stretches.

    Raises
    ------
    RenderError
        If there is no clip, `max_displacement_px` or `contrast_threshold` is not positive, or the
        image moves so fast that frames would be less than 1e-7 s apart.
    SceneError, TrajectoryError
        As `Renderer.trajectory` and `Renderer.white_level`.

    Examples
    --------
    Light that was baked has no noise; path-traced light has:

    >>> from eres_render import Clip, Renderer, load_scene, measure_noise
    >>> renderer = Renderer(load_scene("carpet"), width=64, spp=16, integrator="path")
    >>> noise = measure_noise(renderer, [Clip(0, 0.24, 0.25, 0.26)], 0.5)
    >>> noise.log_noise > 0.01, noise.averages_out
    (True, True)
    """
    if not clips:
        raise RenderError("clips: found none, expected at least one")
    check_positive("contrast_threshold", contrast_threshold, RenderError)
    stretches = [
        adaptive_times(renderer.image_motion, marks_s, max_displacement_px)
        for marks_s in _stretches(clips)
    ]
    seconds = sum(float(t_s[-1] - t_s[0]) for t_s in stretches)
    share = seconds / sum(clip.t_window_end_s - clip.t_start_s for clip in clips)
    frames = sum(map(len, stretches))
    in_image = renderer.camera.width * renderer.camera.height
    scalar = renderer.variant.startswith("scalar")
    samples_a_frame = max(
        _SHARE_OF_RENDER * in_image * renderer.spp / share,
        (_FEW_SECONDS_SCALAR if scalar else _FEW_SECONDS) / frames,
    )
    affordable = int(samples_a_frame / (REPEATS * renderer.spp))
    pixels = min(max(affordable, _MIN_PIXELS), _MAX_PIXELS, in_image)

    rng = np.random.default_rng(renderer.seed)
    fired, excess, variances = [], [], []
    for t_s in stretches:
        chosen = rng.choice(in_image, pixels, replace=False)
        poses = renderer.trajectory.pose(t_s)
        events, of_mean, log_variances = count_events(
            (
                renderer.repeats(pose, chosen, REPEATS, t_s=t)
                for t, pose in zip(t_s.tolist(), poses, strict=True)
            ),
            _DARK_FRACTION * renderer.white_level,
            contrast_threshold,
        )
        fired.append(events)
        excess.append(events - of_mean)
        variances.append(log_variances * len(t_s))
    pixel_seconds = pixels * seconds
    error = math.sqrt(pixels * sum(map(np.var, excess))) / pixel_seconds
    log_noise, log_noise_of_quarter = np.sqrt(np.sum(variances, axis=0) / frames).tolist()
    return Noise(
        log_noise=log_noise,
        contrast_threshold=contrast_threshold,
        events_hz=float(np.sum(fired)) / pixel_seconds,
        false_events_hz=float(np.sum(excess)) / pixel_seconds,
        false_events_error_hz=error,
        log_noise_of_quarter=log_noise_of_quarter,
    )


def _stretches(clips: Sequence[Clip]) -> list[tuple[float, float]]:
    """Return the starts and ends of the stretches of clips that are measured."""
    cut = []
    for clip in clips:
        # A last stretch of a microsecond or less is left out.
        starts_s = np.arange(clip.t_start_s, clip.t_window_end_s - 1e-6, _MAX_STRETCH_S).tolist()
        for start_s in starts_s or [clip.t_start_s]:
            cut.append((start_s, min(start_s + _MAX_STRETCH_S, clip.t_window_end_s)))
    count = min(_STRETCHES, len(cut))
    return [cut[int((k + 0.5) * len(cut) / count)] for k in range(count)]
