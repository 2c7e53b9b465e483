"""Datasets of random scenes."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

from tyro.conf import Fixed, OmitArgPrefixes, Positional, Suppress, arg

from eres_render.errors import check_positive
from eres_render.sequence.clips import WARM_UP_S
from sensor.cameras.files import UNLIMITED
from tasks.cli import terminal
from tasks.cli.camera_options import CameraOptions
from tasks.errors import TaskError
from tasks.events.frame_camera_options import USUAL_CAMERA, FrameCameraOptions
from tasks.events.imu_options import NO_IMU, ImuOptions


@dataclass(frozen=True, kw_only=True)
class _AtEachCutoff(CameraOptions):
    """Without options, the grid of a DAVIS346 with ideal pixels and no bus.

    What options do not say is that of --electronics, or else of --sensor.

    Parameters
    ----------
    resolution
        Side of a square, plain sensor, px.
    cutoffs
        Corner frequencies of the photoreceptor, Hz, or inf for ideal pixels. By default that of the
        sensor, or inf.
    threshold_deviation
        Standard deviation of the contrast threshold over the sequences, log units. Its mean is the
        threshold of the sensor.
    """

    cutoffs: Annotated[tuple[float, ...] | None, arg(metavar="FLOAT [FLOAT ...]")] = None
    threshold_deviation: float = 0.03

    cutoff: Suppress[Fixed[float | None]] = None
    lux: Suppress[Fixed[float | None]] = None
    warm_up: Suppress[Fixed[float | None]] = None


@dataclass(frozen=True, kw_only=True)
class _RandomScenes:
    """Options of random scenes, without --study.

    Parameters
    ----------
    count
        Number of sequences.
    seed
        Seed of the dataset.
    spp
        Samples per pixel: 1, 4, 9, 16, ...
    max_displacement
        Largest motion in the image between two frames, px.
    warm_up
        How long the sensor sees the scene before a sequence starts, seconds. The default is enough
        for 25 Hz; a lower cutoff f needs 6 / (2 pi f).
    stereo
        Add a second camera this far to the right, meters. Its data are in the folder `right` of
        each sequence.
    images
        Also take images with a frame camera, at this rate, Hz.
    scheduler
        Address of a Dask scheduler, tcp://HOST:PORT, whose workers make the sequences. All of them
        must see OUT under the same path.
    """

    count: int = 100
    seed: int = 0
    spp: int = 4
    max_displacement: float = 0.5
    warm_up: Annotated[float, arg(help_behavior_hint=f"(default: {WARM_UP_S:.3g})")] = WARM_UP_S
    stereo: float | None = None
    images: float | None = None
    scheduler: str | None = None


_USUAL, _USUAL_SCENES = _AtEachCutoff(), _RandomScenes()

# Settings whose options have shorter names, for errors.
_OPTIONS = {
    "baseline_m": "stereo",
    "cutoffs_hz": "cutoffs",
    "images_hz": "images",
    "max_displacement_px": "max_displacement",
    "truth_step_s": "truth",
    "warm_up_s": "warm_up",
}


def dataset(
    out: Annotated[Positional[Path], arg(metavar="OUT", help="folder of the dataset")],
    seconds: float = 1.0,
    truth: float = 0.05,
    dry_run: bool = False,
    study: Annotated[str | None, arg(metavar="PRESET|STUDY.toml")] = None,
    scenes: OmitArgPrefixes[_RandomScenes] = _USUAL_SCENES,
    sensor: OmitArgPrefixes[_AtEachCutoff] = _USUAL,
    imu: OmitArgPrefixes[ImuOptions] = NO_IMU,
    frame_camera: OmitArgPrefixes[FrameCameraOptions] = USUAL_CAMERA,
) -> None:
    """Make a dataset of random scenes, to train networks.

    Each sequence is a folder: frames of linear radiance, the scene, and for each cutoff a DSEC file
    of events with the truth. `tasks.datasets.EventDataset` reads them. Surfaces glow with a fixed
    texture, so there are no shadows. The same command continues after an interruption, and with a
    higher --count adds sequences. Sequence k depends only on the seed and on k.

    Parameters
    ----------
    seconds
        Length of each sequence after its warm-up, seconds.
    truth
        Time from one ground truth to the next, seconds.
    dry_run
        Only print how many frames there are, and how much time and disk space they take.
    study
        In place of random scenes, the events of all sensors of a study in each light at each speed:
        a preset such as paper, or a file. Of the other options only --seconds, --truth and
        --dry-run apply.
    """
    from tasks.generation.dataset import make_dataset
    from tasks.generation.sequence import sequence_folder
    from tasks.generation.settings import DatasetSettings, estimate

    if study is not None:
        usual = _USUAL_SCENES, _USUAL, NO_IMU, USUAL_CAMERA
        if (scenes, sensor, imu, frame_camera) != usual:
            raise TaskError(
                "--study: found options for random scenes; give only --seconds, --truth and "
                "--dry-run, as scenes, frames and sensors are in the study"
            )
        _dataset_of(study, out.resolve(), seconds, truth, dry_run)
        return
    if sensor.sensor is None and sensor.resolution is None:
        sensor = replace(sensor, sensor="davis346")
        if sensor.electronics is None:
            bus = sensor.given.get("bus", UNLIMITED)
            sensor = replace(sensor, electronics="ideal", bus=bus)  # type: ignore[call-arg]
    camera = sensor.camera(1, 1)
    try:
        settings = DatasetSettings(
            seed=scenes.seed,
            seconds=seconds,
            sensor=camera,
            cutoffs_hz=sensor.cutoffs or (camera.cutoff_hz,),
            threshold_deviation=sensor.threshold_deviation,
            imu=imu,
            baseline_m=scenes.stereo,
            images_hz=scenes.images,
            camera=frame_camera,
            spp=scenes.spp,
            max_displacement_px=scenes.max_displacement,
            truth_step_s=truth,
            warm_up_s=scenes.warm_up,
        )
    except TaskError as error:
        name, colon, rest = str(error).partition(":")
        raise TaskError(f"{_OPTIONS.get(name, name)}{colon}{rest}") from error
    if dry_run:
        check_positive("count", scenes.count, TaskError)
        finished = sum(sequence_folder(out, number).is_dir() for number in range(scenes.count))
        logging.getLogger(__name__).info(estimate(settings, scenes.count - finished))
        return
    with terminal.progress() as on_progress:
        folders = make_dataset(settings, out.resolve(), scenes.count, scenes.scheduler, on_progress)
    terminal.say(f"{out}: {len(folders)} sequence{'s' * (len(folders) != 1)}")


def _dataset_of(study: str, out: Path, seconds: float, truth: float, dry_run: bool) -> None:
    from tasks.generation.of_study import StudyDataset
    from tasks.study.study_file import preset, preset_names, read_study

    asked = preset(study) if study in preset_names() else read_study(study)
    of_study = StudyDataset(asked, seconds, truth)
    if dry_run:
        logging.getLogger(__name__).info(of_study.estimate(out))
        return
    with terminal.progress() as on_progress:
        files = of_study.make(out, on_progress)
    terminal.say(f"{out}: {len(files)} files of events")
