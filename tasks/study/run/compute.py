"""Compute a job: render, simulate and score, in this process or on a worker."""

from __future__ import annotations

import gc
from dataclasses import dataclass
from importlib.metadata import version

from eres_render import GroundTruth, Renderer, clip_in_progress, ground_truth
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
    """What a run keeps of a job; `files` has highlights, if any, by path in its folder."""

    rows: list[Row]
    timings: JobTimings
    files: dict[str, bytes]
    environment: dict[str, str]


def compute_job(queued: QueuedJob, on_progress: Progress) -> ComputedJob:
    """Render, simulate and score a job; the frames stay in this machine's cache.

    The sensors see each frame as soon as it is rendered.
    """
    job = queued.job
    renderer = _renderer_of(job, on_progress)
    frame_bytes = round(estimate_job(job).frame_bytes)
    with (
        frames_folder(_key_of_frames(job, renderer), frame_bytes) as folder,
        clip_in_progress(renderer, job.clip, folder, job.render.max_displacement_px) as sequence,
    ):
        if renderer not in _truths:
            _truths[renderer] = ground_truth(sequence)
        settings = job.settings(sequence.white_level)
        highlights = Highlights(queued, settings) if queued.with_highlights else None
        push = highlights.push if highlights else None
        result = evaluate(sequence, _truths[renderer], settings, job.evaluate, on_progress, push)
        files = highlights.result(result.reference, sequence) if highlights else {}
    rows = job.with_every_reading(result.rows)
    return ComputedJob(rows, result.timings, files, environment(renderer.variant))


def _key_of_frames(job: Job, renderer: Renderer) -> str:
    """Return the name of a job's frames: a digest of everything that determines them."""
    return digest(
        {
            **job.frames_decided_by,
            "t_offset_us": renderer.trajectory.t_offset_us or None,
            "white_level": renderer.white_level,
            "integrator": renderer.integrator,
            "variant": renderer.variant,
            "mitsuba": version("mitsuba"),
        }
    )


# What loads slowly, for the last scene, as jobs come scene by scene.
_renderers: dict[tuple[object, ...], Renderer] = {}
_truths: dict[Renderer, GroundTruth] = {}


def _renderer_of(job: Job, on_progress: Progress) -> Renderer:
    render = job.render
    scene = job.scene.name, job.scene.digest
    key = *scene, render.resolution, render.height, render.spp, render.seed
    if key not in _renderers:
        _renderers.clear()
        _truths.clear()
        gc.collect()  # Mitsuba scenes are in reference cycles
        release_render_memory()
        _renderers[key] = job.renderer(on_progress)
        warn_if_far_apart(job.scene.name, render.max_displacement_px)
        warn_of_noise(_renderers[key], [job.clip], render.max_displacement_px)
    return _renderers[key]
