"""Datasets of random scenes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.errors import TaskError
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.events.sensor_options import IDEAL_PIXEL, PixelOptions


def dataset(
    out: Annotated[Positional[Path], arg(metavar="OUT", help="folder of the dataset")],
    count: int = 100,
    seconds: float = 1.0,
    seed: int = 0,
    sensor: str | None = None,
    resolution: int | None = None,
    cutoffs: tuple[float, ...] = (math.inf,),
    threshold: float = 0.2,
    threshold_deviation: float = 0.03,
    spp: int = 4,
    max_displacement: float = 0.5,
    truth: float = 0.05,
    stereo: float | None = None,
    images: float | None = None,
    scheduler: str | None = None,
    pixel: OmitArgPrefixes[PixelOptions] = IDEAL_PIXEL,
    imu: OmitArgPrefixes[ImuOptions] = NO_IMU,
    camera: OmitArgPrefixes[FrameCameraOptions] = USUAL_CAMERA,
) -> None:
    """Make a dataset of random scenes for training: frames, events, flow, depth, objects, poses.

    Each sequence is a folder: frames of linear radiance, the scene, and for each cutoff a DSEC file
    of events with the truth. `tasks.datasets.EventDataset` reads them. Surfaces glow with a fixed
    texture: there are no shadows. The same command continues after an interruption, and with a
    higher count adds sequences; sequence k depends on the seed and on k alone.

    Parameters
    ----------
    count
        Number of sequences.
    seconds
        Length of each sequence.
    seed
        Seed of the dataset.
    sensor
        Name of a camera (`eres sensors` lists them); davis346 by default.
    resolution
        Side of a square sensor, px, instead of a camera.
    cutoffs
        Corner frequencies of the photoreceptor, Hz, or inf for ideal pixels.
    threshold
        Mean of the contrast thresholds, log units; each sequence has its own.
    threshold_deviation
        Standard deviation of the contrast threshold over the sequences.
    spp
        Samples per pixel: 1, 4, 9, 16, ...
    max_displacement
        Largest motion in the image between two frames, px.
    truth
        Time from one ground truth to the next, seconds.
    stereo
        Add a right camera this far from the first, meters, in the folder right of each sequence.
    images
        Also take images with a frame camera; their rate, Hz.
    scheduler
        Address of a Dask scheduler, tcp://HOST:PORT; its workers make the sequences. All must see
        OUT under the same path.
    """
    from sensor.presets import find_sensor
    from tasks.cli.progress_bar import progress_bar
    from tasks.generation.dataset import make_dataset
    from tasks.generation.settings import DatasetSettings

    if sensor is not None and resolution is not None:
        raise TaskError("sensor, resolution: found both, expected at most one of them")
    if resolution is not None:
        width = height = resolution
    else:
        model = find_sensor(sensor or "davis346").model
        width, height = model.width, model.height
    settings = DatasetSettings(
        seed=seed,
        seconds=seconds,
        width=width,
        height=height,
        cutoffs_hz=cutoffs,
        threshold=threshold,
        threshold_deviation=threshold_deviation,
        pixel=pixel,
        imu=imu,
        baseline_m=stereo,
        images_hz=images,
        camera=camera,
        spp=spp,
        max_displacement_px=max_displacement,
        truth_step_s=truth,
    )
    with progress_bar(terminal.err) as on_progress:
        folders = make_dataset(settings, out.resolve(), count, scheduler, on_progress)
    made = f"{len(folders)} sequence{'s' * (len(folders) != 1)}"
    terminal.out.print(f"{out}: {made}", soft_wrap=True)
