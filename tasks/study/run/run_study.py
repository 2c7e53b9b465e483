"""Run a study job by job, into a folder that a report can be made from."""

from __future__ import annotations

import json
import logging
from collections.abc import Collection
from itertools import chain
from pathlib import Path
from typing import Any

from eres_render import Scene, list_scenes, load_scene
from eres_render.errors import nearest
from eres_render.progress import Progress, silent
from eres_render.storage.atomic import write_bytes
from eres_render.storage.settings_reader import read_json
from tasks.errors import ResultError, StudyError
from tasks.evaluation.settings import check_methods
from tasks.provenance import check_renderer, command, together
from tasks.row import Row, read_rows, write_rows
from tasks.study.config import Study, to_json
from tasks.study.results.scaling import Scaling
from tasks.study.run.estimate import estimate_work
from tasks.study.run.jobs import Job, QueuedJob, jobs_of, trials
from tasks.study.run.scheduler import Scheduler, open_scheduler

_log = logging.getLogger(__name__)


def run_study(
    study: Study,
    out: Path,
    scheduler: str | None = None,
    on_progress: Progress = silent,
    *,
    mix: bool = False,
) -> list[Row]:
    """Render, simulate and score every job of a study, except for those that `out` already has.

    Writes into `out`: `rows.parquet` (every score), `study.json` (the resolved study, the mean
    speed of each scene's camera at factor 1, and the keys of the jobs), `environment.json`
    (versions and machines, and the command of the last start), `previews/` and `scaling/` (pictures
    and scaling statistics of each scene's first clip), `costs/` (timings of each job), and `parts/`
    (rows of each job, with which a stopped run continues).

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
        Whether the run may continue with another Mitsuba or device than it began with.

    Returns
    -------
    All rows, in the order of the jobs.

    Raises
    ------
    StudyError
        The study asks for something impossible, `out` is a file, the cluster cannot be reached or
        has other code or scenes, or, unless `mix`, Mitsuba or the device differs from that of the
        finished jobs.
    TaskError
        A method does not exist or is for another task.
    MethodError
        A method raises, or returns no valid answer. Methods of the user's own are tried on one
        sample before all jobs.
    RenderError, SensorError, OSError
        As the stages raise them. Files under their final names are complete even then.
    """
    with open_scheduler(scheduler) as computing:
        models = [model for *_, model in study.simulate.models(study.render)]
        speeds_asked = study.simulate.speeds_m_s or study.simulate.speeds
        check_methods(study.evaluate, [(m.width, m.height) for m in models] * len(speeds_asked))
        scenes = _scenes(study)
        work = {job.key: job for scene in scenes for job in jobs_of(study, scene)}
        highlighted = {
            job.scene.name: job for job in reversed(work.values())
        }  # the first of each scene
        if out.exists() and not out.is_dir():
            raise StudyError(f"{out}: found a file, expected a folder for the run")
        rows_of = _rows_so_far(out / "parts", work)
        to_do = []
        for key, job in work.items():
            is_first = job is highlighted[job.scene.name]
            if key not in rows_of or (is_first and not _has_highlights(out, job.scene.name, key)):
                to_do.append(QueuedJob(job, key, is_first))
        so_far = _environment_so_far(out / "environment.json") if rows_of else {}
        if to_do:
            if not mix:
                check_renderer(so_far, computing.environment())
            _log.info("%s", estimate_work([queued.job for queued in to_do], computing.cores).text())
            new = trials(study, [queued.job for queued in to_do], [work[key] for key in rows_of])
            _try_own_methods(new, computing, on_progress)
        speeds = {
            one.name: round(one.trajectory().mean_speed_mps(one.duration_s), 6) for one in scenes
        }
        resolved = {**to_json(study), "base_m_per_s": speeds, "jobs": list(work)}
        if not (out / "rows.parquet").exists():  # otherwise it describes the rows there
            write_bytes(out / "study.json", _json(resolved))
        counted = _counted(on_progress, len(work) - len(to_do), len(work))
        for queued, computed in computing.compute(to_do, counted):
            if not mix:  # workers of a cluster differ
                check_renderer(so_far, computed.environment)
            for name, data in computed.files.items():
                write_bytes(out / name, data)
            so_far = together([so_far, computed.environment])
            write_bytes(out / "environment.json", _json({"command": command(), **so_far}))
            write_rows(_rows_file(out / "parts", queued.key), computed.rows)
            rows_of[queued.key] = computed.rows
    _write_preview_index(out / "previews", list(highlighted))
    rows = list(chain.from_iterable(rows_of[key] for key in work))
    write_rows(out / "rows.parquet", rows)
    write_bytes(out / "study.json", _json(resolved))
    return rows


def _scenes(study: Study) -> list[Scene]:
    """Load the scenes, each with the path that the study gives it.

    Raises
    ------
    StudyError
        Two scenes have the same name, by which rows and files identify them, or the same content,
        by which jobs do, or a task is for a scene that does not exist.
    """
    paths = study.trajectories or {}
    scenes = [load_scene(name, paths.get(name)) for name in study.scenes]
    names = [scene.name for scene in scenes]
    for scene, source in zip(scenes, study.scenes, strict=True):
        if names.count(scene.name) > 1:
            raise StudyError(
                f"scenes: found several named {scene.name!r}, such as {source}, expected different "
                "names of folders or files"
            )
    by_content: dict[str, str] = {}
    for scene in scenes:
        other = by_content.setdefault(scene.digest, scene.name)
        if other != scene.name:
            raise StudyError(
                f"scenes: found {other!r} and {scene.name!r} with the same content, expected each "
                "scene once"
            )
    for task, settings in study.evaluate.items():
        for stretches in settings.plan():
            for name in stretches.scenes:
                if name not in (*names, *list_scenes()):  # a preset's scene may not be in a run
                    raise StudyError(
                        f"evaluate.{task}: found no scene {name!r}; {nearest(name, names)}"
                    )
    return scenes


def _try_own_methods(jobs: list[Job], computing: Scheduler, on_progress: Progress) -> None:
    """Run the user's own methods once, so that a mistake in them shows at once, not hours later.

    Raises
    ------
    MethodError
        As the scorers raise it.
    """
    if not jobs:
        return
    _log.info("trying your own methods on one sample first")
    queued = [QueuedJob(job, job.key, False) for job in jobs]
    for _ in computing.compute(queued, _counted(on_progress, 0, len(jobs))):
        pass  # the study does not keep these scores


def _counted(on_progress: Progress, found: int, total: int) -> Progress:
    """Report progress among all jobs, of which `found` were done before."""

    def counted(stage: str, done: float, of: float, /) -> None:
        on_progress(f"{found + int(done)}/{total} jobs: {stage}", found + done, total)

    return counted


def _rows_file(folder: Path, key: str) -> Path:
    return folder / f"{key}.parquet"


def _rows_so_far(folder: Path, work: Collection[str]) -> dict[str, list[Row]]:
    """Return the rows of finished jobs by key; warn of damaged and of unused files."""
    rows_of = {}
    for key in work:
        file = _rows_file(folder, key)
        if file.exists():
            try:
                rows_of[key] = read_rows(file)
            except ResultError as error:
                _log.warning("%s; the job is computed again", error)
    strangers = {file.stem for file in folder.glob("*.parquet")} - set(work)
    if strangers:
        one = len(strangers) == 1
        _log.warning(
            "%s: %d %s of another study or version %s not used",
            *(folder, len(strangers), "job" if one else "jobs", "is" if one else "are"),
        )
    return rows_of


def _environment_so_far(file: Path) -> dict[str, str]:
    """Return the environment of earlier starts, without their command."""
    if not file.exists():
        return {}
    try:
        found = read_json(dict[str, str], file, ResultError)
    except ResultError as error:
        _log.warning("%s; the provenance of the finished jobs is lost", error)
        return {}
    return {name: value for name, value in found.items() if name != "command"}


def _has_highlights(out: Path, scene: str, key: str) -> bool:
    """Return whether the run has the highlights of a scene, made by this job."""
    try:
        read_json(Any, out / "previews" / f"{scene}.json", ResultError)
        found = read_json(Scaling, out / "scaling" / f"{scene}.json", ResultError)
    except ResultError:
        return False
    return found.job == key


def _write_preview_index(folder: Path, scene_names: list[str]) -> None:
    files = (folder / f"{name}.json" for name in scene_names)
    index = chain.from_iterable(read_json(tuple[Any, ...], file, ResultError) for file in files)
    write_bytes(folder / "index.json", _json(list(index)))


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1).encode()
