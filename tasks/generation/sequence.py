"""One sequence of a dataset: its scene, frames, events and ground truth in a folder."""

from __future__ import annotations

import dataclasses
import gc
import os
import shutil
from functools import partial
from pathlib import Path

from eres_render import Clip, Renderer, load_scene, open_sequence, render_clip
from eres_render.progress import Progress, silent
from eres_render.random_scenes.random_scene import write_random_scene
from eres_render.rendering.backend import release_render_memory
from eres_render.scene.scene import Scene
from eres_render.sequence.manifest import write_manifest
from eres_render.storage.atomic import remove_unfinished, write_text
from eres_render.trajectory.frame_times import paced_times
from eres_render.trajectory.rig import second_camera, to_the_right
from eres_render.trajectory.tum import tum_text
from tasks.events.frame_camera import write_images
from tasks.events.imu_options import NO_IMU
from tasks.events.simulation import SimulationOptions, simulate_frames, simulate_sequence
from tasks.events.truth import groups_to_copy
from tasks.generation.settings import DatasetSettings
from tasks.origin import origin_of

UNFINISHED = ".unfinished"
"""Folder within the dataset's folder, for the sequences that are being made."""


def sequence_folder(out: Path, number: int) -> Path:
    """Return the folder of a complete sequence."""
    return out / f"{number:06d}"


def part(on_progress: Progress, begin: float, share: float, of: float = 1.0) -> Progress:
    """Return what reports a part of some work: where it begins, its share, and all of the work."""

    def on_part(stage: str, done: float, total: float, /) -> None:
        on_progress(stage, begin + share * done / total, of)

    return on_part


def complete_sequence(
    settings: DatasetSettings, number: int, out: Path, on_progress: Progress = silent
) -> None:
    """Make or finish a sequence, and give its folder the final name."""
    folder = sequence_folder(out, number)
    unfinished = out / UNFINISHED / folder.name
    make_sequence(settings, number, unfinished, on_progress)
    remove_unfinished(unfinished)  # of a process that was killed as it wrote
    os.replace(unfinished, folder)


def make_sequence(
    settings: DatasetSettings, number: int, folder: str | Path, on_progress: Progress = silent
) -> None:
    """Make or finish a sequence; existing frames are kept.

    Writes a `RadianceSequence` with its scene in a folder inside; `events_CUTOFF.h5` for each
    cutoff, with events in DSEC's format and the ground truth; and the images of a frame camera, if
    there is one, into `images`. The files of the right camera of a pair are in the folder `right`.

    Parameters
    ----------
    settings
        Settings of the dataset.
    number
        Number of the sequence.
    folder
        Its folder.
    on_progress
        Called with the stage and the share of the work that is done, from 0 to 1.
    """
    folder = Path(folder)
    name = f"random-{settings.seed}-{number:06d}"
    end_s = settings.warm_up_s + settings.seconds
    seed, baseline_m = [settings.seed, number], settings.baseline_m
    width, _ = settings.sensor.size
    write_random_scene(folder / name, seed, end_s, width, baseline_m or 0.0)
    left = load_scene(folder / name)
    if baseline_m is None:
        _make_view(settings, number, left, folder, name, on_progress)
        return
    path = folder / name / "right.txt"
    poses = second_camera(left.trajectory(), to_the_right(baseline_m), left.duration_s)
    write_text(path, tum_text(*poses))
    right = dataclasses.replace(load_scene(folder / name, path), name=f"{name}-right")
    white = _make_view(settings, number, left, folder, name, part(on_progress, 0.0, 0.5))
    on_right = part(on_progress, 0.5, 0.5)
    _make_view(settings, number, right, folder / "right", f"../{name}", on_right, white)


def _make_view(
    settings: DatasetSettings,
    number: int,
    scene: Scene,
    folder: Path,
    source: str,
    on_progress: Progress,
    white_level: float | None = None,
) -> float:
    """Make the files of one camera, and return the radiance of white.

    `white_level` is the radiance of white of the first camera, for the second camera. `source` is
    the path of the scene relative to the folder, so that both can be moved.
    """
    is_first = white_level is None
    on_frame, on_simulation = part(on_progress, 0.1, 0.6), part(on_progress, 0.7, 0.3)
    camera = scene.camera(*settings.sensor.size)
    renderer = Renderer(scene, spp=settings.spp, integrator="emission", camera=camera)
    if white_level is not None:
        renderer.white_level = white_level
    warm_up_s, limit_px = settings.warm_up_s, settings.max_displacement_px
    clip = Clip(number, 0.0, warm_up_s, warm_up_s + settings.seconds)
    sequence = render_clip(renderer, clip, folder, limit_px, on_frame, paced_times)
    write_manifest(folder, dataclasses.replace(sequence.manifest, scene_source=source))
    sequence = open_sequence(folder)
    sensor_seed = settings.sensor_seed(number) + (not is_first)
    imu = settings.imu if is_first else NO_IMU
    models = settings.models(number, sequence.white_level)
    files = [folder / f"events_{name}.h5" for name in models]
    options = SimulationOptions(seed=sensor_seed, readout=settings.sensor.bus, overwrite=True)
    for k, (model, file) in enumerate(zip(models.values(), files, strict=True)):
        if k == 0:
            simulate = partial(simulate_sequence, truth_step_s=settings.truth_step_s, imu=imu)
        else:
            add = groups_to_copy(files[0], ["truth"] if imu.imu is None else ["truth", "imu"])
            simulate = partial(simulate_frames, origin=origin_of(sequence), add=add)
        on_cutoff = part(on_simulation, k, 1, len(models))
        simulate(sequence, model, file, options, on_progress=on_cutoff)
    if settings.images_hz is not None:
        images = folder / "images"
        shutil.rmtree(images, ignore_errors=True)  # from an interrupted run
        write_images(sequence, images, settings.images_hz, settings.camera, seed=sensor_seed)
    del renderer
    gc.collect()  # Mitsuba's scenes are in reference cycles
    release_render_memory()
    return sequence.white_level
