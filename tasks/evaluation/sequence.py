"""One sensor on one sequence: all methods of one task, without a study around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from eres_render import Clip, RadianceSequence, ground_truth, load_scene
from tasks.errors import TaskError
from tasks.evaluation.evaluate import OnProgress, evaluate_part
from tasks.evaluation.warm_up import warn_if_coarse, warn_if_short
from tasks.methods import METHODS
from tasks.row import Row
from tasks.study.config import Evaluate, Render, Simulate
from tasks.study.run.jobs import NOTHING, Part, check_methods

Task = Literal["reconstruction", "flow", "tracking", "video"]


def evaluate_sequence(
    sequence: RadianceSequence,
    task: Task,
    *,
    methods: Sequence[str] = (),
    width: int = 346,
    cutoff_hz: float = math.inf,
    contrast_threshold: float = 0.2,
    speed: float = 1.0,
    on_progress: OnProgress = lambda stage, done, of: None,
) -> list[Row]:
    """Simulate one sensor on a sequence, and score methods of one task on its events.

    Parameters
    ----------
    sequence
        A clip, or a continuous stretch.
    task
        Which task.
    methods
        Names, or "package.module:function"; all listed ones by default.
    width
        Of the square sensor, px.
    cutoff_hz
        Photoreceptor cutoff; inf is ideal.
    speed
        How much faster the scene moves than it was rendered.
    on_progress
        Called with the stage, how much of it is done, and how much there is of it.

    Raises
    ------
    TaskError
        A method does not exist, or the scene does not suit the task.
    """
    wanted = replace(getattr(Evaluate(), task), methods=tuple(methods) or tuple(METHODS[task]))
    evaluate = replace(NOTHING, **{task: wanted})
    check_methods(evaluate)
    if width > sequence.manifest.width:
        raise TaskError(
            f"resolution: found {width} px, finer than the frames of {sequence.manifest.width} px"
        )
    scene = load_scene(sequence.manifest.scene_source)
    if task == "tracking" and scene.plane is None:
        raise TaskError(
            f"{scene.name}: pose tracking needs a planar scene, one whose scene.toml has a [plane]"
        )
    warn_if_short(sequence, cutoff_hz, speed)
    warn_if_coarse(sequence)
    clip = Clip(sequence.manifest.clip, float(sequence.t_s[0]), *sequence.window_s)
    part = Part(
        scene,
        clip,
        Render(resolution=sequence.manifest.width),
        Simulate(
            widths=(width,),
            cutoffs_hz=(cutoff_hz,),
            speeds=(speed,),
            contrast_thresholds=(contrast_threshold,),
        ),
        evaluate,
    )
    return evaluate_part(part, sequence, ground_truth(sequence), on_progress, shown=False).rows
