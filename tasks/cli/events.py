"""Commands for files of events: simulate, convert, describe, look at, turn into images."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from tyro.conf import OmitArgPrefixes, Positional, arg

import eres_render
from eres_render.progress import Progress
from tasks.cli import terminal
from tasks.cli.app import AsJson, WeightsFiles, require, several
from tasks.cli.camera_options import NO_OPTIONS, CameraOptions
from tasks.errors import TaskError, UsageError
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.events.reading import AS_STORED, NO_FOOTAGE, FootageOptions, ReadOptions
from tasks.recording.options import USUAL_VIDEO, VideoOptions
from tasks.view.look import ALL_OF_IT, Look


def simulate(
    path: Annotated[
        Positional[Path],
        arg(metavar="FRAMES", help="folder of a rendered clip, video, or folder of images"),
    ],
    out: Path,
    speed: float = 1.0,
    seed: int = 0,
    format: str | None = None,
    truth: float | None = None,
    overwrite: bool = False,
    footage: OmitArgPrefixes[FootageOptions] = NO_FOOTAGE,
    camera: OmitArgPrefixes[CameraOptions] = NO_OPTIONS,
    imu: OmitArgPrefixes[ImuOptions] = NO_IMU,
) -> None:
    """Simulate a sensor on frames, and write its events.

    The frames are a rendered clip, a video, or a folder of PNG, JPEG, TIFF or EXR images. A sensor
    of another aspect ratio sees their center. Without --sensor and --resolution, the sensor has the
    size of the video or the images; a clip needs one of the options.

    The first line printed states what the simulation assumes. The file includes the events of a
    clip's warm-up. If its format can, it also stores the start and end of the window, the sensor,
    the seed and that line.

    Parameters
    ----------
    out
        File of events: .h5 (DSEC), .raw (Prophesee EVT3), .npz or .txt.
    speed
        Factor by which the scene moves faster than in the frames.
    seed
        Seed of everything random in the sensor.
    format
        Format of the file: dsec, evt3, evt2, npz or text. By default its extension decides.
    truth
        Add true depth, flow and poses to a DSEC file, at this interval in the sequence's time,
        seconds.
    overwrite
        Replace an existing file.
    """
    from tasks.events.footage_simulation import simulate_footage
    from tasks.events.simulation import SimulationOptions, simulate_sequence, warn_of_fill_factor
    from tasks.footage import Footage

    frames = footage.open(path)
    simulate_frames: Any
    if isinstance(frames, Footage):
        for name, value in (("truth", truth), ("imu", imu.imu)):
            if value is not None:
                raise TaskError(f"{path}: is footage; --{name} needs a rendered clip")
        simulate_frames = partial(simulate_footage, frames, interpolate=footage.interpolate)
        usual_width = frames.width
    else:
        simulate_frames = partial(simulate_sequence, frames, truth_step_s=truth, imu=imu)
        usual_width = None
    chosen = camera.camera(frames.width, frames.height, usual_width=usual_width)
    model = chosen.model(**camera.light, white=frames.white_level)
    warn_of_fill_factor(frames, model)
    assumes = chosen.assumptions(**camera.light)
    options = SimulationOptions(
        speed=speed,
        seed=seed,
        readout=chosen.bus,
        warm_up=chosen.warm_up,
        assumes=assumes,
        format=format,
        overwrite=overwrite,
    )
    terminal.say(assumes)
    with terminal.progress() as on_progress:
        count, report = simulate_frames(
            model, out, options, on_progress=_without_compiling(on_progress)
        )
    terminal.say(f"{out}: {count} events of {model.width}x{model.height} px")
    if report is not None:
        terminal.say(f"bus: {report}")


def _without_compiling(on_progress: Progress) -> Progress:
    """Let the first frames, during which Numba compiles, not set the pace."""
    from sensor.compiling import is_cached
    from sensor.kernels.advance import advance_pixels

    def shown(stage: str, done: float, total: float, /) -> None:
        if stage == "simulating" and not is_cached(advance_pixels):
            on_progress("compiling, once, about 20 s", 0, 1)
        else:
            on_progress(stage, done, total)

    return shown


def convert(
    source: Annotated[Positional[Path], arg(metavar="IN", help="file of events")],
    out: Annotated[Positional[Path], arg(metavar="OUT", help="file to write")],
    format: str | None = None,
    input_format: str | None = None,
    shift_us: int = 0,
    from_start: bool = False,
    overwrite: bool = False,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
) -> None:
    """Write a file of events in another format.

    Formats: dsec (.h5, .hdf5), evt3 and evt2 (.raw), npz (.npz), text (.txt). Only to read: csv
    (.csv), aedat3 (.aedat), aedat4 (.aedat4), dat (.dat), es (.es) and bag (.bag). Your own:
    package.module:Format. A warning names what OUT cannot hold. Ground truth and IMU data are
    copied from DSEC to DSEC.

    Parameters
    ----------
    format
        Format of OUT. By default its extension decides, and .raw is EVT3.
    input_format
        Format of IN. By default its extension or header decides.
    shift_us
        Add this to all times, microseconds.
    from_start
        Shift all times so that the first event is at 0.
    overwrite
        Replace OUT if it exists.
    """
    from tasks.events.conversion import convert as convert_file

    count = convert_file(
        source,
        out,
        format=format,
        input_format=input_format,
        reading=reading,
        shift_us=shift_us,
        from_start=from_start,
        overwrite=overwrite,
    )
    terminal.say(f"{out}: {count} events")


def info(
    path: Annotated[
        Positional[Path], arg(metavar="PATH", help="folder of a sequence, or file of events")
    ],
    format: str | None = None,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
    as_json: AsJson = False,
) -> None:
    """Describe a radiance sequence or a file of events.

    Parameters
    ----------
    format
        Format of the file: dsec, evt3, evt2, npz, text, csv, aedat3, aedat4, dat, es, bag or
        package.module:Format. By default its extension or header decides.
    """
    show = terminal.show_json if as_json else terminal.show_pairs
    if path.is_file():
        from tasks.events.description import describe

        show(describe(path, format=format, reading=reading))
        return
    from tasks.events.description import seconds

    if not path.exists():
        raise eres_render.SequenceError(f"{path}: no such file or folder")
    if (format, reading) != (None, AS_STORED):
        wrong = "is a folder; --format and read options need a file of events"
        raise eres_render.SequenceError(f"{path}: {wrong}")
    sequence = eres_render.open_sequence(path)
    manifest, camera = sequence.manifest, sequence.camera
    start_s, end_s = sequence.window_s
    length_m = float(np.diff(sequence.trajectory.length_m(sequence.t_s[[0, -1]]))[0])
    part = "continuous" if sequence.is_continuous else f"clip {manifest.clip}"
    clock = f"time 0 is {seconds(sequence.t_offset_us)} s on the clock of the given poses"
    pinhole = {name: getattr(camera, name) for name in ("fx", "fy", "cx", "cy")}
    terms = {} if camera.distortion is None else dataclasses.asdict(camera.distortion)
    pairs = {
        "scene": f"{manifest.scene}, {part}",
        "found at": sequence.scene_source,
        "frames": f"{len(sequence)} of {manifest.width}x{manifest.height} px, half-float OpenEXR",
        "camera": f"{_terms(pinhole)} px" if terms else "",
        "lens": _terms(terms),
        "time": f"{sequence.t_s[0]:.4f} to {sequence.t_s[-1]:.4f} s",
        "clock": clock if sequence.t_offset_us else "",
        "window": f"{start_s:.4f} to {end_s:.4f} s",
        "camera speed": f"{length_m / (sequence.t_s[-1] - sequence.t_s[0]):.3g} m/s on average",
        "moving objects": ", ".join(manifest.objects),
        "white": f"{sequence.white_level:.4g} W m^-2 sr^-1",
        "samples per pixel": str(manifest.spp),
        "motion per frame": f"at most {manifest.max_displacement_px:g} px",
        "rendered by": f"Mitsuba {manifest.mitsuba}, {manifest.variant}, {manifest.integrator}",
    }
    show({name: value for name, value in pairs.items() if value})


def _terms(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {value:.6g}" for name, value in values.items())


def view(
    sources: Annotated[
        Positional[tuple[Path, ...]],
        several("SOURCE...", "files of events, and folders of rendered clips"),
    ],
    out: Path | None = None,
    rerun: bool = False,
    over: Path | None = None,
    show: Literal["frames", "depth", "flow"] = "frames",
    format: str | None = None,
    overwrite: bool = False,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
    look: OmitArgPrefixes[Look] = ALL_OF_IT,
) -> None:
    """Look at events and clips: video, picture, page or Rerun.

    Several sources are shown side by side. The color of a pixel shows the sum of its polarities in
    the window. The caption states the event rate and, if the file stores them, the size and cutoff
    of the sensor.

    Parameters
    ----------
    out
        File to write: .mp4, .gif or .webp; .png, one picture; .html, a page that plays events
        without a network; .rrd, a recording for the Rerun viewer.
    rerun
        Open the Rerun viewer instead of writing a file (extra `viewer`).
    over
        Draw the events over the frames of this rendered clip, video or folder of images.
    show
        What to draw of rendered clips: their frames, or their true depth or optical flow.
    format
        Format of the files of events, as for `eres info`.
    overwrite
        Replace an existing file.
    """
    from tasks.view.view import view as write_view

    require(sources, "source")
    if rerun == (out is not None):
        raise UsageError("give --out FILE, such as events.mp4, or --rerun, but not both")
    with terminal.progress() as on_progress:
        write_view(
            sources,
            out,
            look,
            over=over,
            show=show,
            reading=reading,
            format=format,
            overwrite=overwrite,
            on_progress=on_progress,
        )
    if out is not None:
        terminal.say(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


def video(
    source: Annotated[Positional[Path], arg(metavar="EVENTS", help="file of events")],
    out: Path,
    calibration: Path | None = None,
    weights: WeightsFiles = (),
    format: str | None = None,
    overwrite: bool = False,
    image: OmitArgPrefixes[VideoOptions] = USUAL_VIDEO,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
) -> None:
    """Make images of a file of events, at regular times.

    Writes PNG files, and timestamps.txt with their times. The high-pass filter needs seconds of
    events to fill the image. Each image is stretched from its 1st percentile to its 99th.

    Parameters
    ----------
    out
        Folder of the images, new or with images of an earlier call.
    calibration
        File of the lens, fx fy cx cy k1 k2 p1 p2 k3; its distortion is removed from the images.
    weights
        Files of networks' weights as METHOD=FILE, or a FILE for the one method that needs weights.
    format
        Format of the file, as for `eres info`.
    overwrite
        Replace the images of an earlier call.
    """
    from tasks.methods.networks import named_weights
    from tasks.recording.recording import open_recording
    from tasks.recording.video import read_calibration, write_video

    recording = open_recording(source, format=format, reading=reading)
    lens = None if calibration is None else read_calibration(calibration, recording.size)
    with terminal.progress() as on_progress:
        count = write_video(
            recording,
            out,
            image,
            calibration=lens,
            weights=named_weights(weights, [image.method]),
            overwrite=overwrite,
            on_progress=on_progress,
        )
    width, height = recording.size
    terminal.say(f"{out}: {count} images of {width}x{height} px")
