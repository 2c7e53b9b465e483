"""The jobs of a study: stretches of a path, each with its sensors and tasks."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from eres_render import Clip, Scene, clips, continuous_stretch
from sensor import SensorModel
from tasks.errors import StudyError
from tasks.evaluation.setting import Setting
from tasks.evaluation.settings import NetworkSettings, Stretches, TaskSettings
from tasks.methods import code_of
from tasks.registry import TASKS
from tasks.study.config import STAGE_VERSIONS, Render, Simulate, Study, digest

_log = logging.getLogger(__name__)

_CHECKED = 101  # poses of a path
_FACING = 1e-9  # 1 - cosine between the axis of the camera and the normal


@dataclass(frozen=True, slots=True)
class Job:
    """A stretch of a scene's path, the sensors that see it, and the tasks that use their events.

    A job is the unit of work: one process renders, simulates and scores it, and a run keeps its
    rows under its `key`. `evaluate` has only the tasks that the job scores.
    """

    scene: Scene
    clip: Clip
    render: Render
    simulate: Simulate
    evaluate: Mapping[str, TaskSettings]

    @property
    def key(self) -> str:
        """Name of the job's rows: a digest of everything that determines them."""
        methods = chain.from_iterable(task.methods for task in self.evaluate.values())
        weights = {k: v for task in self.evaluate.values() for k, v in (task.weights or {}).items()}
        # The content of the weights counts, not their place.
        evaluate = {
            name: replace(task, weights=None) if isinstance(task, NetworkSettings) else task
            for name, task in self.evaluate.items()
        }
        return digest(
            {
                **self._stretch,
                "simulate": self.simulate,
                "evaluate": evaluate,
                "methods": code_of(methods, weights),
                "versions": STAGE_VERSIONS,
            }
        )

    @property
    def frames_decided_by(self) -> dict[str, object]:
        """Everything that determines the job's frames, except for the renderer."""
        light = self.scene.light_digest
        return {**self._stretch, "light": light, "version": STAGE_VERSIONS["render"]}

    @property
    def _stretch(self) -> dict[str, object]:
        return {
            "scene": self.scene.digest,
            "clip": self.clip,
            "render": replace(self.render, samples=None),  # others change nothing here
        }

    def settings(self, white_level: float) -> list[Setting]:
        """Return every sensor at every speed, for frames with this radiance of white."""
        sensors = self.simulate
        photoreceptor = sensors.photoreceptor or "two_pole"
        whole_px = self.render.resolution
        return [
            Setting(
                SensorModel(
                    width=width,
                    height=self.render.height_at(width),
                    contrast_threshold=contrast_threshold,
                    cutoff_hz=cutoff_hz,
                    dark_level=sensors.dark_fraction * white_level,
                    photoreceptor=photoreceptor,
                    cutoff_reference=(
                        white_level if photoreceptor == "v2e" and cutoff_hz < math.inf else None
                    ),
                ),
                speed,
                round(self.clip.t_window_start_s / speed * 1e6),
                round(self.clip.t_window_end_s / speed * 1e6),
                whole_px / width if sensors.same_lens else 1.0,
            )
            for width in sensors.widths
            for cutoff_hz in sensors.cutoffs_hz
            for contrast_threshold in sensors.contrast_thresholds
            for speed in sensors.speeds
        ]


@dataclass(frozen=True, slots=True)
class QueuedJob:
    """A job to compute.

    Parameters
    ----------
    job, key
        The job, and its key when the study began: a method may be edited meanwhile.
    with_highlights
        Whether to make the highlights of its scene for the report.
    """

    job: Job
    key: str
    with_highlights: bool


def jobs_of(study: Study, scene: Scene) -> list[Job]:
    """Return the jobs of a study on one scene.

    Parameters
    ----------
    study
        The study.
    scene
        One of its scenes.

    Returns
    -------
    Jobs, those of the usual samples first.

    Raises
    ------
    StudyError
        The study asks for more samples than the path has, a stretch is longer than the path, no
        method suits the scene, or cameras of one lens do not face its plane.
    """
    if study.simulate.same_lens:
        _check_facing(scene)
    planned = _planned(study, scene)
    if not planned:
        raise StudyError(f"evaluate: found no method that suits {scene.name}, expected one or more")
    return [
        job
        for stretches in sorted(planned)
        for job in _jobs_on(stretches, planned[stretches], study, scene)
    ]


def _check_facing(scene: Scene) -> None:
    """Refuse a scene in which a camera that is farther away would see another image."""
    plane, path = scene.plane, scene.trajectory()
    if plane is not None:
        axes = path.pose(np.linspace(0.0, path.duration_s, _CHECKED))[:, :3, 2]
        if np.all(axes @ plane.normal < _FACING - 1.0):
            return
    found = "a scene with depth" if plane is None else "a camera that turns away from the plane"
    raise StudyError(f"simulate.same_lens: {scene.name}: found {found}, expected one that faces it")


def _planned(study: Study, scene: Scene) -> dict[Stretches, dict[str, TaskSettings]]:
    """Return the tasks of a scene by the stretches that they share."""
    found: dict[Stretches, dict[str, TaskSettings]] = {}
    for task, settings in study.evaluate.items():
        for stretches, planned in settings.plan().items():
            if not planned.methods or scene.name not in (stretches.scenes or [scene.name]):
                continue
            if TASKS[task].planar_only and scene.plane is None:
                _log.info("%s is not planar; %s is skipped on it", scene.name, TASKS[task].title)
                continue
            found.setdefault(stretches._replace(scenes=()), {})[task] = planned
    return found


def _jobs_on(
    stretches: Stretches, tasks: Mapping[str, TaskSettings], study: Study, scene: Scene
) -> Iterator[Job]:
    """Yield the jobs on some stretches; the warm-up is longer at a higher speed."""
    simulate = replace(study.simulate, speeds=stretches.speeds or study.simulate.speeds)
    if stretches.continuous_s:
        run_in_s, duration_s = stretches.continuous_s
        found = [replace(continuous_stretch(scene, duration_s), t_window_start_s=run_in_s)]
    else:
        before_s = stretches.windows_before * study.render.window_s
        render = replace(study.render, window_s=stretches.window_s or study.render.window_s)
        found = _spread_clips(render, scene, simulate.warmup_s + before_s)
    for clip in found:
        yield Job(scene, clip, study.render, simulate, tasks)


def _spread_clips(render: Render, scene: Scene, warmup_s: float) -> list[Clip]:
    """Return the study's samples, spread evenly over the path; all that fit if it says None."""
    fitting = clips(scene, every_s=render.every_s, window_s=render.window_s, warmup_s=warmup_s)
    count = len(fitting) if render.samples is None else render.samples
    if not 1 <= count <= len(fitting):
        raise StudyError(
            f"render.samples: found {render.samples}, expected 1 to {len(fitting)}, which fit the "
            f"path of {scene.name}"
        )
    return [fitting[i] for i in np.linspace(0, len(fitting), count, endpoint=False).astype(int)]


def trials(study: Study, to_do: Collection[Job], done: Iterable[Job]) -> list[Job]:
    """Return small jobs that try every method of the user's own that is new to a run once.

    A method is tried on the first clip that suits it, with the smallest sensor and one sample. The
    frames are those of a job to do, except on a continuous stretch: only as much as a sample's
    window is rendered.

    Parameters
    ----------
    study
        The study.
    to_do, done
        Its jobs without and with scores.

    Returns
    -------
    The trial jobs, none where no method is new.
    """
    known = set(_own_methods_of(done))
    new = [method for method in _own_methods_of(to_do) if method not in known]
    found = []
    for job in to_do:
        planar = job.scene.plane is not None
        fitting = [method for method in new if planar or not TASKS[method[0]].planar_only]
        if fitting:
            found.append(_trial(study, job, fitting))
            new = [method for method in new if method not in fitting]
    return found


def _own_methods_of(jobs: Iterable[Job]) -> list[tuple[str, str]]:
    """Return task and name of each of the user's own methods, once."""
    tasks = (item for job in jobs for item in job.evaluate.items())
    return list(dict.fromkeys((name, m) for name, task in tasks for m in task.methods if ":" in m))


def _trial(study: Study, job: Job, methods: list[tuple[str, str]]) -> Job:
    sensors, clip = study.simulate, job.clip
    if clip.t_window_end_s > clip.t_window_start_s + study.render.window_s:  # continuous
        end_s = clip.t_start_s + study.render.window_s
        clip = replace(clip, t_window_start_s=clip.t_start_s, t_window_end_s=end_s)
    window_s = clip.t_window_end_s - clip.t_window_start_s
    names = {task: tuple(name for at, name in methods if at == task) for task, _ in methods}
    return replace(
        job,
        clip=clip,
        simulate=replace(
            sensors,
            widths=(min(sensors.widths),),
            cutoffs_hz=sensors.cutoffs_hz[:1],
            contrast_thresholds=sensors.contrast_thresholds[:1],
            speeds=sensors.speeds[:1],
        ),
        evaluate={
            task: study.evaluate[task].trial(of_task, window_s) for task, of_task in names.items()
        },
    )
