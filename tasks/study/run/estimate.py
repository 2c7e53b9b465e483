"""Estimate frames, disk and time of jobs before they start.

The estimate is rough, as image motion and event rates are known only afterwards. The constants
are between those of the paper preset on two cores of a virtual AMD EPYC server and of a virtual
Intel Xeon server, which needs a quarter more, with LLVM and looked-up light. The pace of a machine
is how many times as long its jobs take as their estimates say. The cache keeps it, so that
estimates of the next study follow a slow machine from the start.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from eres_render.errors import RenderError
from eres_render.storage.atomic import write_bytes
from eres_render.storage.cache import cache_dir
from eres_render.storage.settings_reader import read_json
from eres_render.trajectory.frame_times import plane_image_motion
from tasks.errors import ResultError
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.timings import JobTimings
from tasks.provenance import VARIANT
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

_KEPT_S = 4 * 3600.0  # of the latest jobs, as other work on a machine comes and goes
_PRIOR_S = 60.0  # as if so much were done as estimated, so that small jobs decide little

_Sums = dict[str, tuple[float, float]]  # estimated and measured core seconds, by machine


@dataclass(frozen=True, slots=True)
class JobEstimate:
    """Estimated work of one job, with every frame rendered, in core seconds.

    `frames_s` is the work while there are frames: rendering (`render_s`), simulating, and methods
    with a state. `samples_s` is the work after that: the other methods, and scores.
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

    Jobs take here `pace` times as long as estimated; None if no job has shown it.
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
    for setting in dict.fromkeys(replace(setting, name="", readout=None) for setting in settings):
        frames_s += 1e-9 * frames * setting.model.width * setting.model.height * _ns_per_px(setting)
    for setting in dict.fromkeys(replace(setting, name="") for setting in settings):
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


def pace_of(environment: Mapping[str, str]) -> float | None:
    """Return measured over estimated core seconds of a machine's latest jobs; None if unknown."""
    sums = _read().get(_machine(environment))
    return None if sums is None else (sums[1] + _PRIOR_S) / (sums[0] + _PRIOR_S)


def add_job(environment: Mapping[str, str], estimate: JobEstimate, timings: JobTimings) -> None:
    """Let a job count for the pace of its machine, without the frames that were in the cache."""
    cached = 1.0 - min(1.0, timings.rendered_frames / estimate.frames)
    sums, machine = _read(), _machine(environment)
    told_s, took_s = sums.get(machine, (0.0, 0.0))
    told_s += estimate.core_s - cached * estimate.render_s
    took_s += timings.core_s
    share = min(1.0, _KEPT_S / told_s)
    sums[machine] = share * told_s, share * took_s
    with suppress(RenderError):  # a study does not fail for it
        write_bytes(_file(), json.dumps(sums, indent=1).encode())


def _machine(environment: Mapping[str, str]) -> str:
    return ", ".join(environment.get(name, "") for name in ("processor", "cores", VARIANT))


def _read() -> _Sums:
    with suppress(ResultError):  # missing, or damaged
        return read_json(_Sums, _file(), ResultError)
    return {}


def _file() -> Path:
    return cache_dir() / "pace.json"
