"""Datasets of random scenes."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, Suppress, arg

from eres_render.sequence.clips import WARM_UP_S
from tasks.cli import terminal
from tasks.errors import TaskError
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.events.sensor_options import NO_PROFILE, PixelOptions, find_grid


@dataclass(frozen=True, slots=True, kw_only=True)
class _PixelsAtEachCutoff(PixelOptions):
    """Properties of real pixels; all are off by default.

    Sources are in the docstring of `sensor.SensorModel`.
    """

    cutoff: Suppress[float | None] = None
    illuminance: Suppress[float | None] = None


_IDEAL_PIXELS = _PixelsAtEachCutoff()

# Settings whose options have shorter names, for errors.
_OPTIONS = {
    "baseline_m": "stereo",
    "cutoffs_hz": "cutoffs",
    "images_hz": "images",
    "max_displacement_px": "max_displacement",
    "truth_step_s": "truth",
    "warm_up_s": "warmup",
}


def dataset(
    out: Annotated[Positional[Path], arg(metavar="OUT", help="folder of the dataset")],
    count: int = 100,
    seconds: float = 1.0,
    seed: int = 0,
    sensor: str | None = None,
    resolution: int | None = None,
    cutoffs: Annotated[
        tuple[float, ...] | None,
        arg(metavar="FLOAT [FLOAT ...]", help_behavior_hint=""),
    ] = None,
    threshold: float | None = None,
    threshold_deviation: float = 0.03,
    spp: int = 4,
    max_displacement: float = 0.5,
    truth: float = 0.05,
    warmup: Annotated[float, arg(help_behavior_hint=f"(default: {WARM_UP_S:.3g})")] = WARM_UP_S,
    stereo: float | None = None,
    images: float | None = None,
    scheduler: str | None = None,
    pixel: OmitArgPrefixes[_PixelsAtEachCutoff] = _IDEAL_PIXELS,
    imu: OmitArgPrefixes[ImuOptions] = NO_IMU,
    camera: OmitArgPrefixes[FrameCameraOptions] = USUAL_CAMERA,
) -> None:
    """Make a dataset of random scenes, to train networks.

    Each sequence is a folder: frames of linear radiance, the scene, and for each cutoff a DSEC file
    of events with the truth. `tasks.datasets.EventDataset` reads them. Surfaces glow with a fixed
    texture: there are no shadows. The same command continues after an interruption, and with a
    higher count adds sequences; sequence k depends only on the seed and on k.

    Parameters
    ----------
    count
        Number of sequences.
    seconds
        Length of each sequence after its warm-up, seconds.
    seed
        Seed of the dataset.
    sensor
        Name of a camera (`eres sensors` lists them); davis346 by default.
    resolution
        Side of a square sensor, px, instead of a camera.
    cutoffs
        Corner frequencies of the photoreceptor, Hz, or inf for ideal pixels; by default that of the
        profile, or inf.
    threshold
        Mean of the contrast thresholds, log units; each sequence has its own. By default that of
        the profile, or 0.2.
    threshold_deviation
        Standard deviation of the contrast threshold over the sequences, log units.
    spp
        Samples per pixel: 1, 4, 9, 16, ...
    max_displacement
        Largest motion in the image between two frames, px.
    truth
        Time from one ground truth to the next, seconds.
    warmup
        How long the sensor sees the scene before a sequence starts, seconds: enough for 25 Hz. A
        slower cutoff needs 6 / (2 pi f) seconds.
    stereo
        Add a second camera this far to the right, meters; its data are in each sequence's folder
        right.
    images
        Also take images with a frame camera, at this rate, Hz.
    scheduler
        Address of a Dask scheduler, tcp://HOST:PORT; its workers make the sequences. All must see
        OUT under the same path.
    """
    from sensor.profiles import find_profile
    from tasks.cli.progress_bar import progress_bar
    from tasks.generation.dataset import make_dataset
    from tasks.generation.settings import DatasetSettings

    if sensor is not None and resolution is not None:
        raise TaskError("sensor, resolution: found both, expected at most one of them")
    settled = pixel.settled()
    if resolution is not None:
        width = height = resolution
    else:
        model = find_grid(sensor or "davis346").model()
        width, height = model.width, model.height
        if pixel.fill_factor is None:
            settled = replace(settled, fill_factor=model.fill_factor)
    profile = NO_PROFILE if pixel.profile is None else find_profile(pixel.profile)
    if cutoffs is None:
        cutoff_hz = profile.number("cutoff")
        if cutoff_hz is None:
            pixel.refuse_photoreceptor("--cutoffs, such as --cutoffs 200")
        cutoffs = (math.inf if cutoff_hz is None else cutoff_hz,)
    if threshold is None:
        threshold = profile.number("threshold_on") or 0.2
    elif pixel.threshold_off is None:  # as in `eres simulate`, one threshold for both
        settled = replace(settled, threshold_off=None)
    try:
        settings = DatasetSettings(
            seed=seed,
            seconds=seconds,
            width=width,
            height=height,
            cutoffs_hz=cutoffs,
            threshold=threshold,
            threshold_deviation=threshold_deviation,
            pixel=settled,
            imu=imu,
            baseline_m=stereo,
            images_hz=images,
            camera=camera,
            spp=spp,
            max_displacement_px=max_displacement,
            truth_step_s=truth,
            warm_up_s=warmup,
        )
    except TaskError as error:
        name, colon, found = str(error).partition(":")
        raise TaskError(f"{_OPTIONS.get(name, name)}{colon}{found}") from error
    with progress_bar(terminal.err) as on_progress:
        folders = make_dataset(settings, out.resolve(), count, scheduler, on_progress)
    made = f"{len(folders)} sequence{'s' * (len(folders) != 1)}"
    terminal.out.print(f"{out}: {made}", soft_wrap=True)
