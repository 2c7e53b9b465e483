"""`RenderedClip`: a sensor on rendered frames, as a source for scorers."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eres_render import Camera, Plane, Trajectory
from eres_render.scene.scene import name_and_seed
from tasks.errors import TaskError
from tasks.evaluation.reference import ReferenceFrames
from tasks.evaluation.scorers.base import Score
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import DenseFlow, Flow, Tracking, Video, unlike_two_poles
from tasks.evaluation.source import FlowPoints, Images, Source, Window, true_points
from tasks.methods.true_video import TrueLight
from tasks.tracking import KNOT_INTERVAL_S, PATH_S, path_at

Float64 = NDArray[np.float64]


class RenderedClip(Source):
    """A sensor on rendered frames; frames, log images and ground truth are in `reference`."""

    def __init__(self, reference: ReferenceFrames, setting: Setting) -> None:
        self.reference, self.setting = reference, setting
        self.model, self.speed = setting.model, setting.speed
        self.window = Window(setting.start_us, setting.end_us)
        self.size = self.model.width, self.model.height
        self.contrast_threshold = self.model.contrast_threshold
        self.off_weight = self.model.off_threshold / self.model.contrast_threshold
        self.log_image = lambda: reference.log_image(setting.model)
        self.log_start = lambda: reference.log_frame(0, setting.model)
        self.log_end = lambda: reference.log_frame(1, setting.model)
        self.log_white = lambda: reference.log_white(setting.model)

    def before_us(self) -> int:
        sequence = self.reference.sequence
        first_us = float(sequence.t_s[0]) / self.speed * 1e6
        if first_us > self.window.before_us + 1:
            start_s, end_s = sequence.window_s
            raise TaskError(
                f"dense_flow: the frames begin at {first_us * 1e-6 * self.speed:g} s, expected "
                f"{2 * start_s - end_s:g} s or earlier, one window before the scored one; render "
                "again with a longer --warm-up and without --continuous"
            )
        return self.window.before_us

    def plane(self) -> Plane | None:
        plane = self.reference.truth.plane
        return plane and replace(plane, offset_m=self.setting.scale * plane.offset_m)

    def camera(self) -> Camera:
        camera = self.reference.camera(*self.size)
        return camera if self.setting.distance == 1.0 else camera.zoomed(self.setting.distance)

    def points(self, task: Flow | DenseFlow) -> FlowPoints:
        features = self.reference.features(task.features, task.seed).at(*self.size)
        return true_points(features, task, range(len(features)))

    def images(self, task: Video) -> Images:
        start_s, end_s = self.reference.sequence.window_s
        count = round((end_s - start_s) / task.every_s)
        if count < 1:
            raise TaskError(
                f"video: found {end_s - start_s:g} s of frames, but one image needs "
                f"{task.every_s:g} s"
            )
        times_s = np.linspace(start_s, end_s, count + 1)[1:].tolist()
        return Images(
            numbers={round(t_s / self.speed * 1e6): i for i, t_s in enumerate(times_s)},
            step_us=1e6 * (end_s - start_s) / count,
            truth=lambda k, name: self.reference.picture(self.model, times_s[k], name),
        )

    def true_light(self, method: str) -> TrueLight:
        model, sequence = self.model, self.reference.sequence
        if other := unlike_two_poles(model):
            raise TaskError(
                f"video, method {method!r}: found {other}, but the method needs photoreceptor "
                "'two_pole' with one cutoff"
            )
        light = model.dark_level or 0.0, model.cutoff_hz, self.speed, model.fill_factor
        return TrueLight(sequence, *light)

    def path(self, task: Tracking) -> Trajectory:
        """Return the true path, in the events' time: a faster camera runs through it sooner."""
        sequence, speed = self.reference.sequence, self.speed
        start_s = sequence.window_s[0]
        end_s = self.reference.truth.trajectory.duration_s
        first_s = start_s - KNOT_INTERVAL_S * speed
        last_s = start_s + (PATH_S + KNOT_INTERVAL_S) * speed
        if first_s < -1e-9 or end_s < last_s - 1e-9:
            raise TaskError(
                f"tracking: the scene's path covers 0 to {end_s:g} s, but speed {speed:g} needs "
                f"{first_s:g} to {last_s:g} s for the tracked path and a knot on each side; lower "
                "the speed, or render clips, without --continuous"
            )
        path, delay_us = path_at(self.pose, 0.0), task.delay_us
        duration_us = round(path.duration_s * 1e6)
        shown_us = round(1e6 * float(sequence.t_s[-1]) / speed) - self.window.start_us
        if duration_us + delay_us > shown_us + 1:  # or the last events come after the frames
            delayed = f", plus {1e-3 * delay_us:g} ms for delays" if delay_us else ""
            raise TaskError(
                f"tracking: at speed {speed:g} the frames last {1e-3 * shown_us:g} ms from "
                f"the start of the window, but the path needs {1e-3 * duration_us:g} ms{delayed}; "
                "lower the speed"
            )
        return path

    def pose(self, t_s: Float64) -> Float64:
        truth, start_s = self.reference.truth, self.reference.sequence.window_s[0]
        poses = truth.trajectory.pose(start_s + t_s * self.speed)
        poses[..., :3, 3] *= self.setting.scale
        plane, distance = self.plane(), self.setting.distance
        return poses if distance == 1.0 or plane is None else farther(poses, plane, distance)

    def seeds(self, task: Tracking) -> tuple[int, int]:
        manifest = self.reference.sequence.manifest
        _, of_scene = name_and_seed(manifest.scene)
        sequence = np.random.SeedSequence([task.seed, manifest.clip, *filter(None, [of_scene])])
        seed = int(sequence.generate_state(1)[0])
        return seed, seed

    def columns(self, score: Score) -> dict[str, Any]:
        setting, manifest = self.setting, self.reference.sequence.manifest
        return {
            "scene": manifest.scene,
            "cutoff_hz": self.model.cutoff_hz,
            "speed": setting.speed,
            "sample": manifest.clip if score.sample is None else score.sample,
            "photoreceptor": self.model.photoreceptor,
            "sensor": setting.name,
            "illuminance_lux": setting.illuminance_lux,
            "speed_m_s": setting.speed_m_s,
            "simulator": setting.emulation.name if setting.emulation else "exact",
            "bus_mev_s": setting.readout.max_rate_hz / 1e6 if setting.readout else math.inf,
        }


def farther(T_world_cam: Float64, plane: Plane, times: float) -> Float64:
    """Move cameras away from a plane, along its normal; `Camera.zoomed` shows the same image.

    (..., 4, 4) poses in and out, with the same rotations, at `times` the distance.
    """
    moved = T_world_cam.copy()
    normal = np.asarray(plane.normal)
    distance_m = moved[..., :3, 3] @ normal - plane.offset_m
    moved[..., :3, 3] += (times - 1) * distance_m[..., None] * normal
    return moved
