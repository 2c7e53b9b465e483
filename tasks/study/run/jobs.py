"""The jobs of a study: stretches of a path, each with its sensors and tasks."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from eres_render import Camera, Clip, Renderer, Scene, Trajectory, clips, continuous_stretch
from eres_render.progress import Progress
from tasks.errors import StudyError
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import NetworkSettings, Stretches, TaskSettings, Tracking
from tasks.methods import code_of, code_of_tasks
from tasks.methods.networks import digests
from tasks.registry import TASKS
from tasks.row import Row
from tasks.study import rules
from tasks.study.config import STAGE_VERSIONS, Render, Simulate, Study, digest
from tasks.study.settings import own_of
from tasks.warm_up import needed_s

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Job:
    """A stretch of a scene's path, the sensors that see it, and the tasks that use their events.

    One process renders, simulates and scores a job; a run keeps its rows under its `key`.
    `evaluate` has only the tasks that the job scores; `scale` is as `scale_of` returns it.
    """

    scene: Scene
    clip: Clip
    render: Render
    simulate: Simulate
    evaluate: Mapping[str, TaskSettings]
    scale: float = 1.0

    @property
    def camera(self) -> Camera:
        """The camera of the frames."""
        return self.scene.camera(self.render.resolution, self.render.height)

    def renderer(self, on_progress: Progress) -> Renderer:
        """Load the scene."""
        render = self.render
        sampled = render.resolution, render.spp, render.seed
        return Renderer(self.scene, *sampled, on_progress=on_progress, camera=self.camera)

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
        decided_by = {
            **self._stretch,
            "simulate": self.simulate.decides,
            "evaluate": evaluate,
            "methods": code_of(methods, weights),
            "versions": STAGE_VERSIONS,
        }
        if self.render.height is not None:
            decided_by["part"] = "whole frames"  # earlier code cropped what rounding left over
        if own := code_of_tasks({name: task.methods for name, task in self.evaluate.items()}):
            decided_by["own tasks"] = own
        return digest(decided_by)

    @property
    def frames_decided_by(self) -> dict[str, object]:
        """Everything that determines the job's frames and what is stored with them, except for the
        renderer."""
        of_scene = {"name": self.scene.name, "light": self.scene.light_digest}
        return {**self._stretch, **of_scene, "version": STAGE_VERSIONS["render"]}

    @property
    def _stretch(self) -> dict[str, object]:
        # The number of samples is left out, as a job does not depend on the others.
        render = replace(self.render, samples=None)
        values = {"scene": self.scene.digest, "clip": self.clip, "render": render}
        if self.scene.settings.objects:
            values["frame times"] = "with objects out of view"  # earlier code left these out
        return values

    def settings(self, white_level: float) -> list[Setting]:
        """Return every sensor at every speed, for frames with this radiance of white."""
        sensors = self.simulate
        speeds_m_s = sensors.speeds_m_s or (0.0,) * len(sensors.speeds)
        emulations = sensors.emulations(self.render, white_level)
        return [
            Setting(
                model if emulation is None else emulation.of(model),
                speed,
                round(self.clip.t_window_start_s / speed * 1e6),
                round(self.clip.t_window_end_s / speed * 1e6),
                name=camera.name,
                readout=sensors.readout(camera),
                illuminance_lux=light.illuminance_lux,
                speed_m_s=speed_m_s,
                distance=self.render.seen_px(model.width, model.height)[0] / model.width
                if sensors.same_lens
                else 1.0,
                scale=self.scale,
                t_start_s=self.clip.anchor_s
                - (
                    needed_s(model.cutoff_hz, speed, sensors.warm_up_s, camera.warm_up)
                    - sensors.warm_up_s
                ),
                emulation=emulation,
            )
            for camera, light, model in sensors.models(self.render, white_level)
            for emulation in emulations
            for speed, speed_m_s in zip(sensors.speeds, speeds_m_s, strict=True)
        ]

    def with_every_reading(self, rows: Iterable[Row]) -> list[Row]:
        """Return the rows with those without a cutoff repeated for every photoreceptor."""
        own = {c.name for c in self.simulate.cameras if "photoreceptors" in own_of(c)}
        others, rows = self.simulate.photoreceptors[1:], list(rows)
        ideal = [row for row in rows if math.isinf(row.cutoff_hz) and row.sensor not in own]
        return rows + [replace(row, photoreceptor=kind) for kind in others for row in ideal]


def weight_digests(evaluate: Mapping[str, TaskSettings]) -> dict[str, str]:
    """Return the SHA-256 of the weights that tasks use, by file."""
    of_tasks = (digests(task.weights, task.methods).items() for task in evaluate.values())
    return dict(chain.from_iterable(of_tasks))


def check_weights(evaluate: Mapping[str, TaskSettings], begun: Mapping[str, str]) -> None:
    """Check that weights are those with which jobs began: the names of their rows say so."""
    for file, now in weight_digests(evaluate).items():
        if now != begun[file]:
            raise StudyError(f"{file}: changed while the study ran; start the study again")


@dataclass(frozen=True, slots=True)
class QueuedJob:
    """A job to compute, with its key when the study began: a method may be edited meanwhile."""

    job: Job
    key: str
    with_highlights: bool


def jobs_of(study: Study, scene: Scene) -> list[Job]:
    """Return the jobs of a study on one scene."""
    # Checks the view of the study's camera.
    path = scene.trajectory(scene.camera(study.render.resolution, study.render.height))
    scale = scale_of(study.simulate, scene, path)
    if speeds_m_s := study.simulate.speeds_m_s:
        base_m_s = scale * round(path.mean_speed_mps(scene.duration_s), 9)  # by quadrature
        if base_m_s == 0:
            raise StudyError(
                f"simulate.speeds_m_s: the camera of {scene.name} does not move; use "
                "simulate.speeds, which are factors"
            )
        speeds = tuple(speed / base_m_s for speed in speeds_m_s)
        study = replace(study, simulate=replace(study.simulate, speeds=speeds))
    rules.check_first_sensor(study)
    if study.simulate.same_lens:
        rules.check_facing(scene, path)
    planned = _planned(study, scene)
    if not planned:
        raise StudyError(f"evaluate: no method suits {scene.name}; add a suitable method")
    on = {stretches: _on(stretches, study) for stretches in planned}
    for render, simulate, _, place in on.values():
        rules.check_speeds(place, simulate, render)
        rules.check_buses(simulate, render)
    rules.check_warm_up([on[at][:3] for at in planned if not at.continuous_s], scene)
    jobs = []
    for stretches in sorted(planned):
        tasks, (render, simulate, before_s, place) = planned[stretches], on[stretches]
        if stretches.continuous_s:
            spread = [_continuous_clip(scene, *stretches.continuous_s)]
        else:
            spread = _spread_clips(render, scene, simulate, before_s)
        if isinstance(tracking := tasks.get("tracking"), Tracking):
            left_s = path.duration_s - max(clip.t_window_start_s for clip in spread)
            rules.check_tracked(place, render, simulate, 1e-6 * tracking.delay_us, left_s)
        jobs += [Job(scene, clip, study.render, simulate, tasks, scale) for clip in spread]
    return jobs


def distance_m_of(scene: Scene, path: Trajectory) -> float | None:
    """Return the camera's median distance from the plane along its axis."""
    if scene.plane is None:
        return None
    T = path.pose(np.linspace(0.0, scene.duration_s, rules.POSES))
    return round(float(np.median(scene.plane.distance(T[:, :3, 3], T[:, :3, 2]))), 9)


def scale_of(simulate: Simulate, scene: Scene, path: Trajectory) -> float:
    """Return the factor by which a study enlarges a scene and its path."""
    if simulate.distance_m is None:
        return 1.0
    own_m = distance_m_of(scene, path)
    if own_m is None:
        raise StudyError(f"simulate.distance_m: {scene.name} is not planar; use planar scenes")
    return simulate.distance_m / own_m


def _planned(study: Study, scene: Scene) -> dict[Stretches, dict[str, TaskSettings]]:
    """Return the tasks of a scene by the stretches that they share."""
    tasks_on: dict[Stretches, dict[str, TaskSettings]] = {}
    for task, stretches, planned in rules.plans(study):
        if not planned.methods or scene.name not in (stretches.scenes or [scene.name]):
            continue
        if "a plane" in TASKS[task].needs and scene.plane is None:
            _log.info("%s is not planar; %s is skipped on it", scene.name, TASKS[task].title)
            continue
        tasks_on.setdefault(stretches._replace(scenes=()), {})[task] = planned
    return tasks_on


def _on(stretches: Stretches, study: Study) -> tuple[Render, Simulate, float, str]:
    """Return render, sensors, the seconds between their warm-up and the scored window, and the
    field with the speeds."""
    render, simulate = study.render, study.simulate
    before_s = stretches.windows_before * render.window_s
    place = f"simulate.{'speeds' if simulate.speeds_m_s is None else 'speeds_m_s'}"
    if stretches.window_s:
        render = replace(render, window_s=stretches.window_s)
    if stretches.speeds:
        simulate = replace(simulate, speeds=stretches.speeds, speeds_m_s=None)
        place = "evaluate.flow.fast_speed"
    return render, simulate, before_s, place


def _continuous_clip(scene: Scene, run_in_s: float, duration_s: float) -> Clip:
    """Return one stretch from the start of the path, scored after its run-in."""
    if duration_s > scene.duration_s:
        raise StudyError(
            f"evaluate.video.duration_s: found {duration_s:g} s, expected at most "
            f"{scene.duration_s:g} s, the duration of the path of {scene.name}"
        )
    return replace(continuous_stretch(scene, duration_s), t_window_start_s=run_in_s)


def _spread_clips(render: Render, scene: Scene, simulate: Simulate, before_s: float) -> list[Clip]:
    """Return the study's samples, spread evenly over the path; all that fit by default."""
    rules.check_path(render, scene)
    fitting = clips(
        scene,
        every_s=render.every_s,
        window_s=render.window_s,
        warm_up_s=simulate.longest_warm_up_s + before_s,
        anchor_s=simulate.warm_up_s + before_s,
    )
    count = len(fitting) if render.samples is None else render.samples
    if not 1 <= count <= len(fitting):
        raise StudyError(
            f"render.samples: found {render.samples}, expected 1 to {len(fitting)}, the number "
            f"that fits on the path of {scene.name}"
        )
    return [fitting[i] for i in np.linspace(0, len(fitting), count, endpoint=False).astype(int)]


def trials(study: Study, to_do: Collection[Job], done: Iterable[Job]) -> list[Job]:
    """Return small jobs that try each of the user's own methods once before its first use in a run.

    A method is tried on the first clip that suits it, with the smallest sensor and one sample. Its
    job uses the same frames later, except on a continuous stretch, of which a trial renders a
    window.
    """
    known, tried = methods_of(done), []
    new = [at for at in methods_of(to_do) if TASKS[at[0]].is_own(at[1]) and at not in known]
    for job in to_do:
        if fitting := [method for method in new if _suits(study, job, *method)]:
            tried.append(_trial(study, job, fitting))
            new = [method for method in new if method not in fitting]
    return tried


def methods_of(jobs: Iterable[Job]) -> dict[tuple[str, str], None]:
    """Return task and name of each method of some jobs, once and in their order."""
    tasks = (item for job in jobs for item in job.evaluate.items())
    return dict.fromkeys((task, name) for task, of_task in tasks for name in of_task.methods)


def _suits(study: Study, job: Job, task: str, method: str) -> bool:
    """Return whether a method can be tried on the clip of a job."""
    if task in job.evaluate and method in job.evaluate[task].methods:
        return True
    has_own_clips = any(at.windows_before or at.window_s for at in study.evaluate[task].plan())
    return not has_own_clips and not ("a plane" in TASKS[task].needs and job.scene.plane is None)


def _trial(study: Study, job: Job, methods: list[tuple[str, str]]) -> Job:
    clip = job.clip
    planned = chain.from_iterable(task.plan() for task in study.evaluate.values())
    longest_s = max(study.render.window_s, *(stretches.window_s for stretches in planned))
    if clip.t_window_end_s > clip.t_window_start_s + longest_s + 1e-9:  # continuous
        end_s = clip.t_start_s + study.render.window_s
        clip = replace(clip, t_window_start_s=clip.t_start_s, t_window_end_s=end_s)
    window_s = clip.t_window_end_s - clip.t_window_start_s
    names = {task: tuple(name for at, name in methods if at == task) for task, _ in methods}
    evaluate = {task: study.evaluate[task].trial(own, window_s) for task, own in names.items()}
    return replace(job, clip=clip, simulate=job.simulate.first(job.render), evaluate=evaluate)
