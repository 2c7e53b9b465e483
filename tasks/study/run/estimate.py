"""Estimate frames, disk and time of jobs before they start.

The estimate is rough, as image motion and event rates are known only afterwards. The constants
are between those of the paper preset on two cores of a virtual AMD EPYC server and of a virtual
Intel Xeon server, which needs a quarter more, with LLVM and looked-up light.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from eres_render.trajectory.frame_times import plane_image_motion
from tasks.evaluation.sensor_setting import Setting
from tasks.registry import TASKS
from tasks.study.run.frame_cache import limit_bytes
from tasks.study.run.jobs import Job

_IMAGE_MOTION_PX_S = 900  # at base speed, where a 1280 px image of the room moves fastest
_PARTS = 8  # of a stretch of a planar scene, over which the image motion is summed
_DISK_BYTES_PER_PX = 2.01  # of a half-float EXR, uncompressed
# One core, per pixel of a frame, with writing it, and per sample; a plane has fewer edges.
_RENDER_NS_ON_PLANE = (17, 3.4)
_RENDER_NS_WITH_DEPTH = (70, 5.2)
# One core, per pixel, frame, sensor and speed; with collecting. With v2e pixels differ in poles.
_SIMULATE_NS_PER_PX = {"two_pole": 8.5, "one_pole": 8.5, "v2e": 27}
_EMULATE_NS_PER_PX = 15  # one core, per pixel and frame that it sees


@dataclass(frozen=True, slots=True)
class JobEstimate:
    """Estimated work of one job, with every frame rendered.

    Parameters
    ----------
    frames_s
        Core seconds while there are frames: rendering, simulating, and methods with a state.
    samples_s
        Core seconds after that: the other methods, and scores.
    render_s
        Core seconds of `frames_s` for rendering.
    """

    frames: int
    frame_bytes: float
    frames_s: float
    samples_s: float
    render_s: float

    @property
    def core_s(self) -> float:
        """Core seconds of the whole job."""
        return self.frames_s + self.samples_s


def work_text(jobs: Sequence[Job], cores: int, pace: float | None = None) -> str:
    """Estimate the work of jobs, in a line; frames in the cache count as if they were missing.

    Parameters
    ----------
    pace
        Times as long as `estimate_job` says that jobs take here; None if no job has shown it.
    """
    each = [estimate_job(job) for job in jobs]
    seconds = sum(job.core_s for job in each) / cores * (1.0 if pace is None else pace)
    hours, minutes = divmod(round(seconds / 60), 60)
    time = f"{hours} h {minutes} min" if hours else f"{max(minutes, 1)} min"
    size = min(sum(job.frame_bytes for job in each), limit_bytes())
    whose = "a fast server's pace" if pace is None else "this machine's pace"
    return (
        f"{len(each)} job{'s' * (len(each) != 1)} to do: about {sum(job.frames for job in each)} "
        f"frames, {size / 1e9:.2g} GB on disk, {time} at {whose}"
    )


def estimate_job(job: Job) -> JobEstimate:
    """Estimate the work of one job."""
    render, frames = job.render, _frames(job)
    px = render.resolution * render.height_at(render.resolution)
    ns_px, ns_sample = _RENDER_NS_WITH_DEPTH if job.scene.plane is None else _RENDER_NS_ON_PLANE
    render_s = 1e-9 * frames * px * (ns_px + ns_sample * render.spp)
    frames_s, samples_s = render_s, 0.0
    # Sensors that differ in their name alone share their scores, and beside their bus their pixels.
    settings = job.settings(1.0)
    for setting in dict.fromkeys(replace(one, name="", readout=None) for one in settings):
        frames_s += 1e-9 * frames * setting.model.width * setting.model.height * _ns_per_px(setting)
    for setting in dict.fromkeys(replace(one, name="") for one in settings):
        for task, of_task in job.evaluate.items():
            score_s = of_task.score_s(setting.model.width, setting.model.height)
            if TASKS[task].sample is None:  # events are pushed to its methods
                frames_s += score_s
            else:
                samples_s += score_s
    return JobEstimate(frames, frames * px * _DISK_BYTES_PER_PX, frames_s, samples_s, render_s)


def _ns_per_px(setting: Setting) -> float:
    """Return the core time of simulating a pixel of a sensor in a frame, ns."""
    if setting.emulation:
        return _EMULATE_NS_PER_PX / setting.emulation.every
    ideal = math.isinf(setting.model.cutoff_hz)
    return _SIMULATE_NS_PER_PX["two_pole" if ideal else setting.model.photoreceptor]


def _frames(job: Job) -> int:
    start_s, end_s, plane = job.clip.t_start_s, job.clip.t_window_end_s, job.scene.plane
    if plane is None:
        motion_px = (end_s - start_s) * _IMAGE_MOTION_PX_S * job.render.resolution / 1280
    else:
        moved = plane_image_motion(job.scene.trajectory(job.camera), job.camera, plane)
        times_s = np.linspace(start_s, end_s, _PARTS + 1).tolist()
        motion_px = sum(moved(start, end) for start, end in pairwise(times_s))
    return 2 + round(motion_px / job.render.max_displacement_px)
