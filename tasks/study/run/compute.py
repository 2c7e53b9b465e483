"""Compute a job: render, simulate and score, in this process or on a worker."""

from __future__ import annotations

import gc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version

from eres_render import GroundTruth, RadianceSequence, clip_in_progress, ground_truth
from eres_render.progress import Progress
from eres_render.rendering.backend import release_render_memory
from eres_render.sequence.monte_carlo_noise import warn_of_noise
from eres_render.trajectory.frame_times import warn_if_far_apart
from tasks.evaluation.central_part import central_part
from tasks.evaluation.evaluate import evaluate
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.timings import JobTimings, of_one_job
from tasks.provenance import environment
from tasks.row import Row
from tasks.study.config import Render, digest
from tasks.study.run.estimate import estimate_job
from tasks.study.run.frame_cache import frames_folder
from tasks.study.run.highlights import Highlights
from tasks.study.run.jobs import Job, QueuedJob


@dataclass(frozen=True, slots=True)
class ComputedJob:
    """What a run keeps of a job.

    Parameters
    ----------
    files
        Contents of highlights, if asked for, by path in the run's folder.
    """

    rows: list[Row]
    timings: JobTimings
    files: dict[str, bytes]
    environment: dict[str, str]


def compute_job(queued: QueuedJob, on_progress: Progress) -> ComputedJob:
    """Render, simulate and score a job; the frames stay in this machine's cache.

    The sensors see each frame as soon as it is rendered.

    Returns
    -------
    Scores, files for the run's folder, and the environment.
    """
    job = queued.job
    light = _light_of(job, on_progress)
    with (
        frames_folder(light.key(job), round(estimate_job(job).frame_bytes)) as folder,
        clip_in_progress(
            light.renderer, job.clip, folder, job.render.max_displacement_px
        ) as sequence,
    ):
        settings = job.settings(sequence.white_level)
        highlights = Highlights(queued, settings) if queued.with_highlights else None
        push = highlights.push if highlights else None
        before = replace(sequence.rendered)
        rows: list[Row] = []
        timings: list[JobTimings] = []
        reference = None  # of the first shape; the others' would fill the memory
        for size, of_shape in _by_shape(settings, job.render).items():
            part = central_part(sequence, light.truth(sequence), *size)
            result = evaluate(*part, of_shape, job.evaluate, on_progress, push)
            rows += result.rows
            timings.append(result.timings)
            reference = reference or result.reference
        whole = of_one_job(timings, before)
        whole = replace(whole, resolution=sequence.width, height=sequence.height)
        files = highlights.result(reference, sequence) if highlights and reference else {}
    rows = job.with_every_reading(rows)
    return ComputedJob(rows, whole, files, environment(light.renderer.variant))


def _by_shape(settings: Sequence[Setting], render: Render) -> dict[tuple[int, int], list[Setting]]:
    """Group sensors by width and height of the part of the frames that they see."""
    groups: dict[tuple[int, int], list[Setting]] = {}
    for setting in settings:
        size = render.seen_px(setting.model.width, setting.model.height)
        groups.setdefault(size, []).append(setting)
    return groups


class _SceneLight:
    """A scene's renderer and ground truth, which load slowly."""

    def __init__(self, job: Job, on_progress: Progress) -> None:
        self.renderer = job.renderer(on_progress)
        self._truth: GroundTruth | None = None

    def key(self, job: Job) -> str:
        """Return the name of the job's frames: a digest of everything that determines them."""
        return digest(
            {
                **job.frames_decided_by,
                "t_offset_us": self.renderer.trajectory.t_offset_us or None,
                "white_level": self.renderer.white_level,
                "integrator": self.renderer.integrator,
                "variant": self.renderer.variant,
                "mitsuba": version("mitsuba"),
            }
        )

    def truth(self, sequence: RadianceSequence) -> GroundTruth:
        """Return the ground truth, the same for every sequence of the scene."""
        self._truth = self._truth or ground_truth(sequence)
        return self._truth


_loaded: dict[tuple[object, ...], _SceneLight] = {}  # at most one, as jobs come scene by scene


def _light_of(job: Job, on_progress: Progress) -> _SceneLight:
    render = job.render
    scene = job.scene.name, job.scene.digest
    key = *scene, render.resolution, render.height, render.spp, render.seed
    if key not in _loaded:
        _loaded.clear()
        gc.collect()  # Mitsuba scenes are in reference cycles
        release_render_memory()
        _loaded[key] = _SceneLight(job, on_progress)
        warn_if_far_apart(job.scene.name, render.max_displacement_px)
        warn_of_noise(_loaded[key].renderer, [job.clip], render.max_displacement_px)
    return _loaded[key]
