"""Estimate frames, disk and time of jobs before they start.

The estimate is rough, as image motion and event rates are known only afterwards. The constants
are between those of the paper preset on two cores of a virtual AMD EPYC server and of a virtual
Intel Xeon server, which needs a quarter more, with LLVM and looked-up light.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from eres_render.trajectory.frame_times import plane_image_motion
from tasks.study.run.frame_cache import limit_bytes
from tasks.study.run.jobs import Job

_IMAGE_MOTION_PX_S = 700  # mean at base speed, fastest part of a 1280 px image, scenes with depth
_PARTS = 8  # of a stretch of a planar scene, over which the image motion is summed
_DISK_BYTES_PER_PX = 2.01  # of a half-float EXR, uncompressed
_RENDER_SAMPLES_PER_S = 330e6  # both cores together, with writing the frames
# One core, per pixel, frame, sensor and speed; with collecting. With v2e pixels differ in poles.
_SIMULATE_NS_PER_PX = {"two_pole": 8, "one_pole": 8, "v2e": 26}
_CORES_MEASURED_ON = 2


@dataclass(frozen=True, slots=True)
class WorkEstimate:
    """Estimated work of jobs.

    Parameters
    ----------
    jobs, frames
        Their numbers.
    frame_bytes
        Size of all frames; the cache may keep fewer.
    seconds
        Wall-clock time with all cores at work.
    """

    jobs: int
    frames: int
    frame_bytes: float
    seconds: float

    def text(self) -> str:
        """Return the estimate as one line of text."""
        hours, minutes = divmod(round(self.seconds / 60), 60)
        time = f"{hours} h {minutes} min" if hours else f"{max(minutes, 1)} min"
        kept = min(self.frame_bytes, limit_bytes())
        return (
            f"{self.jobs} job{'s' * (self.jobs != 1)} to do: about {self.frames} frames, "
            f"{kept / 1e9:.2g} GB on disk, {time}"
        )


def estimate_work(jobs: Sequence[Job], cores: int) -> WorkEstimate:
    """Estimate the work of jobs; frames in the cache count as if they were missing.

    Parameters
    ----------
    jobs
        The jobs.
    cores
        Number of cores that share the work.

    Returns
    -------
    The estimate.
    """
    frames = [_frames(job) for job in jobs]
    pixels = [job.render.resolution * job.render.height_at(job.render.resolution) for job in jobs]
    seconds = 0.0
    for job, n, px in zip(jobs, frames, pixels, strict=True):
        seconds += n * px * job.render.spp / _RENDER_SAMPLES_PER_S * _CORES_MEASURED_ON
        for sensor, _, model in job.simulate.models(job.render):
            kind = model.photoreceptor if math.isfinite(model.cutoff_hz) else "two_pole"
            ns_per_px = _SIMULATE_NS_PER_PX[kind]
            one_s = n * sensor.width * sensor.height * 1e-9 * ns_per_px
            one_s += sum(task.score_s(sensor.width) for task in job.evaluate.values())
            seconds += len(job.simulate.speeds) * one_s
    size = sum(n * px * _DISK_BYTES_PER_PX for n, px in zip(frames, pixels, strict=True))
    return WorkEstimate(len(jobs), sum(frames), size, seconds / cores)


def _frames(job: Job) -> int:
    start_s, end_s, plane = job.clip.t_start_s, job.clip.t_window_end_s, job.scene.plane
    if plane is None:
        motion_px = (end_s - start_s) * _IMAGE_MOTION_PX_S * job.render.resolution / 1280
    else:
        camera = job.scene.camera(job.render.resolution, job.render.height)
        moved = plane_image_motion(job.scene.trajectory(), camera, plane)
        times_s = np.linspace(start_s, end_s, _PARTS + 1).tolist()
        motion_px = sum(moved(one, two) for one, two in pairwise(times_s))
    return 2 + round(motion_px / job.render.max_displacement_px)
