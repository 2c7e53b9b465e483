"""The events of a study's sensors as a dataset: each scene, sensor, light and speed is a set."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

from eres_render import load_scene, render_clip
from eres_render.cores import cores
from eres_render.progress import Progress, cost, silent
from eres_render.storage.locks import LockedError, locked
from tasks.errors import TaskError
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import Evaluate, Video, settings_of
from tasks.events.simulation import SimulationOptions, simulate_sequence
from tasks.generation.settings import BYTES_A_TRUTH_PX, BYTES_AN_EVENT, claim_table
from tasks.registry import TASKS
from tasks.study.run.estimate import estimate_job
from tasks.study.run.jobs import Job, jobs_of
from tasks.study.settings import Study, to_json

_log = logging.getLogger(__name__)

# Measured on the carpet, ideal pixels: a pixel of 1280 px in each second of the path; of coarser
# pixels it falls as this power of the width, and behind a cutoff as 1 / (1 + _SLOW_HZ speed / f).
_EVENTS_PER_PX_S, _POWER, _SLOW_HZ = 226, 0.57, 55
_FRAME_SHARE = 0.65  # of a frame that remains after its compression
_READ_NS_PER_PX, _WRITE_NS_PER_EVENT = 20, 80  # of one core: a frame, and an event


class StudyDataset:
    """A dataset of the sets of a study, with its first photoreceptor, simulated exactly.

    A set is `seconds` of the path from its start, after a warm-up for the slowest sensor at the
    highest speed. Images of the ground truth are `truth_step_s` of the path apart.
    """

    def __init__(self, study: Study, seconds: float, truth_step_s: float) -> None:
        simulate = replace(
            study.simulate,
            photoreceptors=study.simulate.photoreceptors[:1],
            simulators=("exact",),
            frame_steps_px=None,
        )
        warm_up_s = simulate.longest_warm_up_s
        stretch = Video(
            methods=("blank",),
            run_in_s=warm_up_s,
            duration_s=warm_up_s + seconds,
            every_s=seconds,
        )
        tasks = {task: settings_of(task, ()) for task in TASKS} | {"video": stretch}
        study = replace(study, simulate=simulate, evaluate=Evaluate(**tasks))
        scenes = (load_scene(name, (study.trajectories or {}).get(name)) for name in study.scenes)
        self._jobs = [job for scene in scenes for job in jobs_of(study, scene)]
        self._truth_step_s = truth_step_s
        asked = to_json(study)
        chosen = {name: asked[name] for name in ("scenes", "render", "simulate")}
        self._table = {**chosen, "warm_up_s": warm_up_s, "seconds": seconds, "truth": truth_step_s}

    def files(self, out: Path) -> list[Path]:
        """Return the files of all sets."""
        return [file for job in self._jobs for file in _sets(job, out, 1.0)]

    def estimate(self, out: Path) -> str:
        """Describe in one line what the missing sets take."""
        disk_bytes = core_s = frames = missing = 0.0
        for job in self._jobs:
            of_job = estimate_job(job)
            path_s = job.clip.t_window_end_s - job.clip.t_start_s
            todo = {file: at for file, at in _sets(job, out, 1.0).items() if not file.exists()}
            frame_px = job.render.resolution * job.render.height_at(job.render.resolution)
            if todo:
                frames += of_job.frames
                disk_bytes += _FRAME_SHARE * of_job.frame_bytes
                core_s += of_job.render_s
            for at in todo.values():
                px = at.model.width * at.model.height
                slow = 1 + _SLOW_HZ * at.speed * (at.model.width / 1280) / at.model.cutoff_hz
                rate = _EVENTS_PER_PX_S * (at.model.width / 1280) ** _POWER / slow
                truths = (job.clip.t_window_end_s - job.clip.t_window_start_s) / self._truth_step_s
                disk_bytes += px * (rate * path_s * BYTES_AN_EVENT + truths * BYTES_A_TRUTH_PX)
                core_s += 1e-9 * of_job.frames * (_READ_NS_PER_PX * frame_px + 8.5 * px)
                core_s += 1e-9 * px * rate * path_s * _WRITE_NS_PER_EVENT
            missing += len(todo)
        of = f"{missing:.0f} of {len(self.files(out))} sets to make"
        return f"{of}: about {frames:.0f} frames, {cost(disk_bytes, core_s / min(cores(), 2))}"

    def make(self, out: Path, on_progress: Progress = silent) -> list[Path]:
        """Make the sets that do not exist yet, and return the files of all.

        A scene is a folder of frames, and a set is a file in it that is named only when it is
        complete.
        """
        claim_table(self._table, out)
        try:
            with locked(out / ".lock", wait=False):
                if not all(file.exists() for file in self.files(out)):
                    _log.info("%s", self.estimate(out))
                for job in self._jobs:
                    self._make_scene(job, out, on_progress)
        except LockedError:
            raise TaskError(f"{out}: another process is making this dataset; wait for it") from None
        return self.files(out)

    def _make_scene(self, job: Job, out: Path, on_progress: Progress) -> None:
        if all(file.exists() for file in _sets(job, out, 1.0)):
            return
        renderer = job.renderer(on_progress)
        folder, limit_px = out / job.scene.name, job.render.max_displacement_px
        sequence = render_clip(renderer, job.clip, folder, limit_px, on_progress)
        del renderer
        sets = _sets(job, out, sequence.white_level)
        for number, (file, at) in enumerate(sets.items(), start=1):
            if file.exists():
                continue

            def on_set(stage: str, done: float, total: float, /, number: int = number) -> None:
                on_progress(f"{job.scene.name}, set {number} of {len(sets)}, {stage}", done, total)

            options = SimulationOptions(speed=at.speed, readout=at.readout)
            file.parent.mkdir(exist_ok=True)
            truth_step_s = self._truth_step_s
            simulate_sequence(
                sequence, at.model, file, options, truth_step_s=truth_step_s, on_progress=on_set
            )


def _sets(job: Job, out: Path, white_level: float) -> dict[Path, Setting]:
    """Return the sets of a scene by their files; that in ideal light once, at the first speed."""
    return {
        out / job.scene.name / (at.name or f"{at.model.width}px") / _file_name(at): at
        for at in reversed(job.settings(white_level))
    }


def _file_name(at: Setting) -> str:
    speed = "" if math.isinf(at.model.cutoff_hz) else f"_x{at.speed:.3g}"
    return f"events_{at.model.cutoff_hz:g}_C{at.model.contrast_threshold:g}{speed}.h5"
