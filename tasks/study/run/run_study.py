"""Run a study job by job, into a folder that a report can be made from."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eres_render import Scene, load_scene
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import clear_unfinished
from eres_render.storage.locks import LockedError, locked
from tasks.errors import StudyError
from tasks.evaluation.settings import check_methods
from tasks.row import Row
from tasks.study import rules
from tasks.study.config import Study, to_json
from tasks.study.results.words import distances_label
from tasks.study.run.estimate import add_job, estimate_job, pace_of, work_text
from tasks.study.run.jobs import (
    Job,
    QueuedJob,
    check_weights,
    distance_m_of,
    jobs_of,
    methods_of,
    trials,
    weight_digests,
)
from tasks.study.run.run_folder import RunFolder
from tasks.study.run.scheduler import open_scheduler

_log = logging.getLogger(__name__)


def run_study(
    study: Study,
    out: str | Path,
    scheduler: str | None = None,
    on_progress: Progress = silent,
    *,
    mix: bool = False,
) -> list[Row]:
    """Render, simulate and score every job of a study, except for those that `out` already has.

    Writes into `out`: `rows.parquet` (every score), `study.json` (the resolved study, the mean
    speed of each scene's camera at factor 1, the distances at which speeds in m/s hold, and the
    keys of the jobs), `environment.json` (versions and machines, and the command of the last
    start), `previews/` and `scaling/` (pictures and scaling statistics of each scene's first clip),
    `costs/` (timings of each job), and `jobs/` (rows of each job, with which a stopped run
    continues).

    Parameters
    ----------
    study
        The study.
    out
        Folder of the run.
    scheduler
        Address of a Dask scheduler with workers that compute the jobs; None for this process.
    on_progress
        Called as jobs proceed; jobs of earlier starts count as done.
    mix
        Allow resuming with another Mitsuba version or device than the run started with.

    Returns
    -------
    All rows, in the order of the jobs.

    Raises
    ------
    StudyError
        The study asks for something impossible or for do-nothing methods alone, `out` is a file,
        another process is computing this run, the cluster has other code or scenes, or, unless
        `mix`, Mitsuba or the device differs from that of the finished jobs.
    TaskError
        A method does not exist or is for another task, or the cluster cannot be reached.
    MethodError
        A method raises, or returns no valid answer. Methods of the user's own are tried on one
        sample before all jobs.
    RenderError, SensorError, OSError
        As the stages raise them. Files under their final names are complete even then.
    """
    out = Path(out)
    with open_scheduler(scheduler) as computing:
        sizes = [(model.width, model.height) for *_, model in study.simulate.models(study.render)]
        speeds = study.simulate.speeds_m_s or study.simulate.speeds
        check_methods(study.evaluate, sizes * len(speeds))
        weights = weight_digests(study.evaluate)  # before the keys, which have them too
        work = {job.key: job for scene in _scenes(study) for job in jobs_of(study, scene)}
        rules.check_compares(methods_of(work.values()))
        folder = RunFolder(out, work, mix=mix)
        resolved = _resolved(study, work)
        if study.simulate.distance_m is None and (own_m := resolved.get("plane_distance_m")):
            _log.info("speeds in m/s apply at each scene's distance: %s", distances_label(own_m))
        to_do = folder.to_do()
        if not to_do:
            folder.describe(resolved)
            return folder.finish(resolved)
        here = computing.environment()
        folder.check(here)
        jobs = [queued.job for queued in to_do]
        _log.info("%s", work_text(jobs, max(1, computing.cores), pace_of(here)))
        if new := trials(study, jobs, [work[key] for key in folder.finished]):
            # A mistake in the user's own methods shows at once, not hours later.
            _log.info("trying your own methods on one sample first")
            trying = [QueuedJob(job, job.key, False) for job in new]
            for _ in computing.compute(trying, _counted(on_progress, [], len(new))):
                pass  # the study does not keep these scores
        lacking = {queued.key for queued in to_do}
        done = [key for key in work if key not in lacking]
        before_s = sum(estimate_job(work[key]).core_s for key in done)
        counted = _counted(on_progress, done, len(work), before_s)
        try:
            with locked(out / ".lock", wait=False):
                clear_unfinished(out)
                folder.describe(resolved)
                for nth, (queued, computed) in enumerate(computing.compute(to_do, counted)):
                    check_weights(study.evaluate, weights)
                    folder.keep(queued, computed)
                    done.append(queued.key)
                    if nth and here:  # the first one compiles; workers may share their cores
                        add_job(here, estimate_job(queued.job), computed.timings)
        except LockedError:
            raise StudyError(f"{out}: another process is computing this run; wait for it") from None
    return folder.finish(resolved)


def _resolved(study: Study, jobs: Mapping[str, Job]) -> dict[str, Any]:
    """Return the study with its defaults, what follows for each scene, and the keys of jobs."""
    simulate = study.simulate
    speeds, distances = {}, {}
    for job in {job.scene.name: job for job in jobs.values()}.values():
        scene, path = job.scene, job.scene.trajectory(job.camera)
        speeds[scene.name] = round(job.scale * path.mean_speed_mps(scene.duration_s), 6)
        own_m = distance_m_of(scene, path)
        if simulate.speeds_m_s and own_m and not simulate.same_lens:  # whose widths have their own
            distances[scene.name] = round(job.scale * own_m, 6)
    follows: dict[str, Any] = {"assumes": simulate.assumes, "base_m_per_s": speeds}
    if distances:
        follows["plane_distance_m"] = distances
    return {**to_json(study), **follows, "jobs": list(jobs)}


def _scenes(study: Study) -> list[Scene]:
    """Load the scenes, each with the path that the study gives it."""
    paths = study.trajectories or {}
    scenes = [load_scene(name, paths.get(name)) for name in study.scenes]
    rules.check_scenes(study, scenes)
    return scenes


def _counted(
    on_progress: Progress, done: Sequence[str], total: int, before_s: float = 0.0
) -> Progress:
    """Return what reports the progress of some jobs among all `total` jobs of a run.

    A run adds keys of finished jobs to `done`. `before_s` is the estimated core seconds of the jobs
    that earlier starts finished.
    """

    def on_jobs(stage: str, done_s: float, of_s: float, /) -> None:
        on_progress(f"{len(done)}/{total} jobs: {stage}", before_s + done_s, before_s + of_s)

    return on_jobs
