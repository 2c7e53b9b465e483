"""How many samples and frames are enough: events of one stretch for different numbers of both."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eres_render import Renderer, Scene
from eres_render.progress import Progress
from eres_render.sequence.clips import WARM_UP_S
from eres_render.trajectory.frame_times import adaptive_times
from sensor import plain_camera, stream
from sensor.levels import DARK_SHARE
from tasks.errors import TaskError
from tasks.methods.event_integration import reconstruct
from tasks.reconstruction import ReconstructionSample, log_white_level, psnr_db

SPP = (1, 4, 16, 64)
DISPLACEMENTS_PX = (2.0, 1.0, 0.5, 0.25)
CONTRAST_THRESHOLD = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderSetting:
    """Settings with which a stretch is rendered.

    `max_displacement_px` is the largest motion in the image from one frame to the next. With
    `fresh_seeds`, each frame has its own random numbers, otherwise all share one set.
    """

    spp: int
    max_displacement_px: float
    fresh_seeds: bool = False


FINEST = RenderSetting(spp=max(SPP), max_displacement_px=min(DISPLACEMENTS_PX))
USUAL = RenderSetting(spp=16, max_displacement_px=0.5)
QUICK = RenderSetting(spp=4, max_displacement_px=1.0)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one setting, for an ideal sensor at the frames' resolution.

    The PSNR is of event integration from the setting's own frame at the start of the stretch,
    against the last frame of the finest setting.
    """

    setting: RenderSetting
    frames: int
    events: int
    psnr_db: float


def settings() -> list[RenderSetting]:
    """Return the finest setting, then coarser ones in samples and steps, and the quick preset's."""
    by_spp = [replace(USUAL, spp=spp) for spp in SPP]
    by_displacement = [replace(USUAL, max_displacement_px=px) for px in DISPLACEMENTS_PX]
    each = dict.fromkeys([*by_spp, *by_displacement, QUICK])  # the usual one is there twice
    return [FINEST, *(replace(s, fresh_seeds=fresh) for fresh in (False, True) for s in each)]


def converge(
    scene: Scene, *, resolution: int, duration_s: float, on_progress: Progress
) -> Iterator[Outcome]:
    """Render one stretch in the middle of a path in every setting; yield the results one by one.

    The sensor sees `WARM_UP_S` of the path before the stretch. Frames and sensor are square.
    """
    start_s = 0.5 * scene.duration_s
    if not 0 < duration_s <= start_s:
        most = f"at most {start_s:g} s, half the path"
        raise TaskError(f"duration: found {duration_s} s, expected more than 0 and {most}")
    base = Renderer(scene, resolution, FINEST.spp)
    marks_s = max(0.0, start_s - WARM_UP_S), start_s, start_s + duration_s
    log_truth: NDArray[np.float64] | None = None
    for setting in settings():
        frames, events, polarity_sum, ends = _simulated(base, setting, marks_s, on_progress)
        if log_truth is None:
            log_truth = ends[1]
        sample = ReconstructionSample(ends[0], polarity_sum, CONTRAST_THRESHOLD)
        psnr = psnr_db(reconstruct(sample), log_truth, log_white_level(log_truth))
        yield Outcome(setting, frames, events, psnr)


def _simulated(
    base: Renderer,
    setting: RenderSetting,
    marks_s: tuple[float, float, float],
    on_progress: Progress,
) -> tuple[int, int, NDArray[np.float64], list[NDArray[np.float64]]]:
    """Return a stretch's frames, events, polarity sums, and log light at its start and its end."""
    renderer, dark_level = base.at(spp=setting.spp), DARK_SHARE * base.white_level
    side = base.camera.width
    camera = plain_camera(side).with_threshold(CONTRAST_THRESHOLD)
    model = camera.model(white=base.white_level)
    t_s = adaptive_times(base.image_motion, marks_s, setting.max_displacement_px)
    first = int(np.searchsorted(t_s, marks_s[1]))
    ends: list[NDArray[np.float64]] = []
    seeds = "fresh" if setting.fresh_seeds else "common"
    stage = f"{setting.spp} spp, {setting.max_displacement_px:g} px, {seeds} seeds"

    def frames() -> Iterator[NDArray[np.float32]]:
        for k, (t, pose) in enumerate(zip(t_s, renderer.trajectory.pose(t_s), strict=True)):
            on_progress(stage, k, len(t_s))
            frame = renderer.frame(pose, seed=k if setting.fresh_seeds else None, t_s=t)
            if k in (first, len(t_s) - 1):
                ends.append(np.log(frame.astype(np.float64) + dark_level))
            yield frame

    polarity_sum, count = np.zeros((side, side)), 0
    for events in stream(frames(), t_s, model):
        inside = events.between(*(round(1e6 * t) for t in marks_s[1:]))
        polarity_sum += inside.polarity_sum()
        count += len(inside)
    return len(t_s) - first, count, polarity_sum, ends
