"""Score methods of one task on one sensor and one sequence, without a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from eres_render import RadianceSequence, ground_truth, load_scene
from eres_render.errors import check_positive
from eres_render.progress import Progress, silent
from sensor import SensorModel
from sensor.levels import DARK_FRACTION
from tasks.errors import TaskError, WeightsError
from tasks.evaluation.evaluate import evaluate
from tasks.evaluation.setting import Setting
from tasks.methods import check_method
from tasks.registry import TASKS, load
from tasks.row import Row
from tasks.warm_up import needed_s, warn_if_coarse, warn_if_short


def evaluate_sequence(
    sequence: RadianceSequence,
    task: str,
    *,
    methods: Sequence[str] = (),
    width: int = 346,
    cutoff_hz: float = math.inf,
    contrast_threshold: float = 0.2,
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
    width
        Width of the sensor, px. It sees all of the frames, and has their shape to within a pixel.
    cutoff_hz
        Photoreceptor cutoff, Hz; inf is an ideal pixel.
    contrast_threshold
        C, log units.
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
        A method does not exist or cannot run, the sensor has no width or is finer than the frames,
        or the task needs another scene or lens.
    WeightsError
        Weights are given for something that is not a network of the task.
    """
    spec = TASKS[task]
    check_positive("speed", speed, TaskError)
    check_positive("resolution", width, TaskError)
    if strangers := set(weights or ()) - set(spec.networks):
        raise WeightsError(f"weights: found {min(strangers)}, expected a network of task {task}")
    names = tuple(methods) or spec.usual(weights or ())
    for name in names:
        check_method(task, name, weights)
    if width > sequence.manifest.width:
        raise TaskError(
            f"resolution: found {width} px, finer than the frames of {sequence.manifest.width} px"
        )
    scene = load_scene(sequence.scene_source)
    if spec.planar_only and scene.plane is None:
        raise TaskError(
            f"{scene.name}: {spec.title} needs a planar scene, one whose scene.toml has a [plane]"
        )
    if spec.planar_only and (lens := sequence.camera.distortion) is not None:
        raise TaskError(f"{sequence.folder}: {spec.title} needs a pinhole: found a lens, {lens}")
    options = {"weights": dict(weights)} if weights else {}
    settings = load(spec.settings)(methods=names, **options)
    windows_before = max((one.windows_before for one in settings.plan()), default=0)
    warn_if_short(sequence, cutoff_hz, speed, windows_before)
    warn_if_coarse(sequence)
    truth = ground_truth(sequence)
    height = truth.camera(width).height
    for name in names:
        check_method(task, name, weights, [(width, height)])
    model = SensorModel(
        width=width,
        height=height,
        contrast_threshold=contrast_threshold,
        cutoff_hz=cutoff_hz,
        dark_level=DARK_FRACTION * sequence.white_level,
    )
    start_us, end_us = (round(t_s / speed * 1e6) for t_s in sequence.window_s)
    start_s, end_s = sequence.window_s
    t_start_s = start_s - windows_before * (end_s - start_s) - needed_s(cutoff_hz, speed)
    setting = Setting(model, speed, start_us, end_us, t_start_s=t_start_s)
    return evaluate(sequence, truth, [setting], {task: settings}, on_progress).rows
