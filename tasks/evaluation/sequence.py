"""Score methods of one task on one sensor and one sequence, without a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from eres_render import RadianceSequence, ground_truth, load_scene
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor import EventCamera, plain_camera
from tasks.errors import TaskError, WeightsError
from tasks.evaluation.evaluate import evaluate
from tasks.evaluation.sensor_setting import Setting
from tasks.evaluation.settings import settings_of
from tasks.evaluation.source import ALL, check_needs
from tasks.methods import check_method
from tasks.registry import TASKS
from tasks.row import Row
from tasks.warm_up import needed_s, warn_of_frames


def evaluate_sequence(
    sequence: RadianceSequence,
    task: str,
    *,
    methods: Sequence[str] = (),
    camera: EventCamera | int = 346,
    lux: float | None = None,
    cutoff_hz: float | None = None,
    speed: float = 1.0,
    weights: Mapping[str, str] | None = None,
    on_progress: Progress = silent,
) -> list[Row]:
    """Simulate one sensor on a sequence, and score methods of one task on its events.

    Parameters
    ----------
    sequence
        A clip, or a continuous stretch.
    task
        Name of the task.
    methods
        Names, or "package.module:function"; by default all methods of the task except diagnostics
        and networks whose weights are not given.
    camera
        The camera, with its bus, or the width of a plain one in px, which has the frames' shape. It
        sees the largest central part of the frames that has its shape.
    lux, cutoff_hz
        As for `EventCamera.model`.
    speed
        Factor by which the scene moves faster than it was rendered.
    weights
        Files of weights by the names of the methods that need them.
    on_progress
        Called with the stage, the amount done, and the total.

    Returns
    -------
    One row for each method, item and variant.

    Raises
    ------
    TaskError
        A method does not exist or cannot run, or the task needs another scene or lens.
    SensorError
        As `EventCamera.model`, or the camera is finer than the frames.
    WeightsError
        Weights are given for something that is not a network of the task.
    """
    spec = TASKS[task]
    check_positive("speed", speed, TaskError)
    if strangers := set(weights or ()) - set(spec.networks):
        raise WeightsError(f"weights: {min(strangers)} is not a network of task {task}")
    names = tuple(methods) or spec.usual(weights or ())
    scene = load_scene(sequence.scene_source)
    planar = scene.plane is not None
    kind = "a rendered sequence" if planar else "a scene without [plane]"
    check_needs(task, scene.name, kind, ALL if planar else ALL - {"a plane"})
    if "a plane" in spec.needs and (lens := sequence.camera.distortion) is not None:
        raise TaskError(f"{sequence.folder}: {spec.title} needs a pinhole camera; found {lens}")
    settings = settings_of(task, names, weights)
    windows_before = max((stretch.windows_before for stretch in settings.plan()), default=0)
    truth = ground_truth(sequence)
    if isinstance(camera, int):
        camera = plain_camera(camera, truth.camera(camera).height)
    model = camera.model(lux=lux, cutoff_hz=cutoff_hz, white=sequence.white_level)
    for name in names:
        check_method(task, name, weights, [(model.width, model.height)])
    warn_of_frames(sequence, model.cutoff_hz, speed, windows_before, camera.warm_up)
    start_s, end_s = sequence.window_s
    warm_up_s = needed_s(model.cutoff_hz, speed, time_constants=camera.warm_up)
    setting = Setting(
        model,
        speed,
        start_us=round(start_s / speed * 1e6),
        end_us=round(end_s / speed * 1e6),
        name=camera.name,
        readout=camera.bus,
        illuminance_lux=lux or 0.0,
        t_start_s=start_s - windows_before * (end_s - start_s) - warm_up_s,
    )
    return evaluate(sequence, truth, [setting], {task: settings}, on_progress).rows
