"""Compute a job: render, simulate and score, in this process or on a worker."""

from __future__ import annotations

import gc
from dataclasses import dataclass
from importlib.metadata import version

from eres_render import GroundTruth, RadianceSequence, Renderer, clip_in_progress, ground_truth
from eres_render.progress import Progress
from eres_render.rendering.backend import release_render_memory
from eres_render.sequence.monte_carlo_noise import warn_of_noise
from eres_render.trajectory.frame_times import warn_if_far_apart
from tasks.evaluation.evaluate import evaluate
from tasks.evaluation.timings import JobTimings
from tasks.provenance import environment
from tasks.row import Row
from tasks.study.config import digest
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
        truth = light.truth(sequence)
        result = evaluate(sequence, truth, settings, job.evaluate, on_progress, push)
        files = highlights.result(result.reference, sequence) if highlights else {}
    rows = job.with_every_reading(result.rows)
    return ComputedJob(rows, result.timings, files, environment(light.renderer.variant))


class _SceneLight:
    """A scene's renderer and ground truth, which load slowly."""

    def __init__(self, job: Job, on_progress: Progress) -> None:
        render = job.render
        camera = job.scene.camera(render.resolution, render.height)
        self.renderer = Renderer(
            job.scene,
            render.resolution,
            render.spp,
            render.seed,
            on_progress=on_progress,
            camera=camera,
        )
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
