"""One sequence of a dataset: its scene, frames, events and ground truth in a folder."""

from __future__ import annotations

import dataclasses
import gc
import os
import shutil
from pathlib import Path
from typing import Any

from eres_render import Clip, Renderer, load_scene, open_sequence, render_clip
from eres_render.progress import Progress, silent
from eres_render.random_scenes.random_scene import write_random_scene
from eres_render.rendering.backend import release_memory
from eres_render.sequence.manifest import write_manifest
from eres_render.trajectory.frame_times import paced_times
from tasks.events.frame_camera import write_images
from tasks.events.simulation import origin_of, simulate_frames, simulate_sequence
from tasks.events.truth import groups_to_copy
from tasks.generation.settings import DatasetSettings

# Where each stage begins in the time of a sequence, and its share; only the progress bar uses this.
_STAGES = {"rendering": (0.1, 0.6), "simulating": (0.7, 0.3)}


UNFINISHED = ".unfinished"
"""Folder, in that of the dataset, of the sequences that are being made."""


def sequence_folder(out: Path, number: int) -> Path:
    """Return the folder of a complete sequence.

    Parameters
    ----------
    out, number
        Folder of the dataset, number of the sequence.

    Returns
    -------
    folder
        The folder, which may not exist.
    """
    return out / f"{number:06d}"


def complete_sequence(
    settings: DatasetSettings, number: int, out: Path, on_progress: Progress = silent
) -> None:
    """Make a sequence, or finish one, and give the folder its name.

    Parameters
    ----------
    settings, number, on_progress
        As for `make_sequence`.
    out
        Folder of the dataset.
    """
    folder = sequence_folder(out, number)
    make_sequence(settings, number, out / UNFINISHED / folder.name, on_progress)
    os.replace(out / UNFINISHED / folder.name, folder)


def make_sequence(
    settings: DatasetSettings, number: int, folder: Path, on_progress: Progress = silent
) -> None:
    """Make a sequence, or finish one: frames that exist are kept.

    Writes a `RadianceSequence` with its scene in a folder inside, and `events_CUTOFF.h5` for each
    cutoff: events in DSEC's format, with the ground truth; and the images of a frame camera into
    `images`, if there is one.

    Parameters
    ----------
    settings
        Settings of the dataset.
    number
        Number of the sequence.
    folder
        Its folder.
    on_progress
        Called with the stage and the share of the work that is done, of 1.
    """

    def on_stage(stage: str, done: float, total: float, /) -> None:
        begin, share = _STAGES[stage]
        on_progress(stage, begin + share * done / total, 1.0)

    scene_folder = folder / f"random-{settings.seed}-{number:06d}"
    end_s = settings.warm_up_s + settings.seconds
    write_random_scene(scene_folder, [settings.seed, number], end_s, settings.width)
    scene = load_scene(scene_folder)
    camera = scene.camera(settings.width, settings.height)
    renderer = Renderer(scene, spp=settings.spp, integrator="emission", camera=camera)
    clip = Clip(number, 0.0, settings.warm_up_s, end_s)
    limit_px = settings.max_displacement_px
    sequence = render_clip(renderer, clip, folder, limit_px, on_stage, paced_times)
    # Where the scene is from here, so that the folder can be moved.
    write_manifest(folder, dataclasses.replace(sequence.manifest, scene_source=scene.name))
    sequence = open_sequence(folder)
    models = settings.models(number, sequence.white_level)
    first: Path | None = None
    for k, (name, model) in enumerate(models.items()):

        def on_cutoff(stage: str, done: float, total: float, /, k: int = k) -> None:
            on_stage(stage, k + done / total, len(models))

        file = folder / f"events_{name}.h5"
        how: Any = {
            "seed": settings.sensor_seed(number),
            "overwrite": True,
            "on_progress": on_cutoff,
        }
        if first is None:
            first, how["imu"] = file, settings.imu
            simulate_sequence(sequence, model, file, truth_step_s=settings.truth_step_s, **how)
        else:
            copied = ["truth"] if settings.imu.imu is None else ["truth", "imu"]
            how |= {"add": groups_to_copy(first, copied), "origin": origin_of(sequence)}
            simulate_frames(sequence, model, file, **how)
    if settings.images_hz is not None:
        images = folder / "images"
        shutil.rmtree(images, ignore_errors=True)  # of a start that was stopped here
        seed = settings.sensor_seed(number)
        write_images(sequence, images, settings.images_hz, settings.camera, seed=seed)
    del renderer
    gc.collect()  # scenes in Mitsuba are parts of cycles
    release_memory()
