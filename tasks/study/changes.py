"""A study with some of its settings changed, as by options of a command."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eres_render.errors import check_positive
from tasks.errors import StudyError, WeightsError
from tasks.evaluation.settings import Evaluate
from tasks.methods import task_of
from tasks.registry import TASKS
from tasks.study.settings import Study


def with_scenes(study: Study, scenes: Sequence[str], trajectory: str | Path | None = None) -> Study:
    """Return a study of other scenes.

    Parameters
    ----------
    study
        The study.
    scenes
        Names, folders or files of scenes; empty keeps the study's.
    trajectory
        File of poses, in place of the scene's own path.

    Returns
    -------
    The study, with only the trajectories of these scenes.

    Raises
    ------
    StudyError
        One trajectory is given for several scenes.
    """
    chosen = tuple(scenes) or study.scenes
    given = {_place(name): file for name, file in (study.trajectories or {}).items()}
    paths = {name: given[_place(name)] for name in chosen if _place(name) in given}
    if trajectory is not None:
        if len(chosen) > 1:
            raise StudyError(f"trajectory: {len(chosen)} scenes cannot share it; choose one scene")
        paths = {chosen[0]: str(trajectory)}
    return replace(study, scenes=chosen, trajectories=paths or None)


def _place(scene: str) -> str:
    """Return the name of a packaged scene, or the one path by which a folder or file is known."""
    return os.path.abspath(scene) if is_path(scene) else scene


def is_path(scene: str) -> bool:
    """Return whether a scene is a folder with a "/" or a Mitsuba file, not a packaged name."""
    return "/" in scene or scene.endswith(".xml")


def with_resolution(study: Study, resolution: int) -> Study:
    """Return a study with frames of another size, without the sensors that are finer.

    Parameters
    ----------
    study
        The study.
    resolution
        Side of the frames, px; their width, if they are not square.

    Returns
    -------
    The study.

    Raises
    ------
    StudyError
        All sensors are finer than the frames, or the side is not positive.
    """
    check_positive("--resolution", resolution, StudyError)
    render, simulate = study.render, study.simulate
    height = None if render.height is None else render.height_at(resolution)
    render = replace(render, resolution=resolution, height=height)
    widths = tuple(width for width in simulate.widths if width <= resolution)
    sensors = tuple(
        camera
        for camera in simulate.sensors
        if all(np.less_equal(camera.size, render.seen_px(*camera.size)))
    )
    if not (widths or sensors):
        per_row = study.render.resolution / study.render.height_at(study.render.resolution)
        sizes = [camera.size for camera in simulate.sensors]
        sides = [math.ceil(max(width, height * per_row)) for width, height in sizes]
        raise StudyError(
            f"--resolution: found {resolution} px, expected at least "
            f"{min([*simulate.widths, *sides])} px, the size of the study's coarsest sensor"
        )
    return replace(study, render=render, simulate=replace(simulate, widths=widths, sensors=sensors))


def with_method(study: Study, name: str) -> Study:
    """Return a study with one more method.

    Parameters
    ----------
    study
        The study.
    name
        A registered method that belongs to a single task, or "package.module:function", whose
        annotations tell which task it solves.

    Returns
    -------
    The study with the method added to its task.

    Raises
    ------
    TaskError
        If the method cannot be imported, or its task is unclear.
    """
    task = task_of(name)
    section = study.evaluate[task]
    section = replace(section, methods=tuple(dict.fromkeys((*section.methods, name))))
    return replace(study, evaluate=Evaluate(**{**study.evaluate, task: section}))


def with_weights(study: Study, weights: Mapping[str, str]) -> Study:
    """Return a study with files of weights.

    Parameters
    ----------
    study
        The study.
    weights
        Files by method; the methods have a network.

    Returns
    -------
    The study with the weights in the settings of the tasks that have these methods.

    Raises
    ------
    WeightsError
        The study does not use one of the methods.
    """
    used = set()
    sections = dict(study.evaluate)
    for task, section in sections.items():
        own = {name: weights[name] for name in TASKS[task].networks if name in weights}
        used |= own.keys() & {*section.methods}
        if own:
            changed: dict[str, Any] = {"weights": {**(section.weights or {}), **own}}
            sections[task] = replace(section, **changed)
    for name in weights:
        if name not in used:
            raise WeightsError(f"weights: {name} is not among the study's methods")
    return replace(study, evaluate=Evaluate(**sections))
