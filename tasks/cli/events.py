"""Commands for files of events: simulate, convert."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.camera_options import NO_OPTIONS, CameraOptions
from tasks.errors import TaskError
from tasks.events.footage_options import NO_FOOTAGE, FootageOptions, open_source_frames
from tasks.events.imu_options import NO_IMU, ImuOptions
from tasks.events.reading import AS_STORED, ReadOptions

if TYPE_CHECKING:
    from sensor import ReadoutReport


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
    whose shape differs from theirs sees their center; without --sensor and --resolution it has the
    size of footage. The first line printed is what the simulation assumes. The file includes the
    events of a clip's warm-up and, if its format can hold them, the start and end of its window,
    the sensor, the seed and that line.

    Parameters
    ----------
    out
        File of events: .h5 (DSEC), .raw (Prophesee EVT3), .npz or .txt.
    speed
        Factor by which the scene moves faster than in the frames.
    seed
        Seed of everything random in the sensor.
    format
        dsec, evt3, evt2, npz or text, instead of what the extension says.
    truth
        Add true depth, flow and poses to a DSEC file, this many seconds of the sequence's time
        apart.
    overwrite
        Replace an existing file.
    """
    from tasks.events.footage_simulation import simulate_footage
    from tasks.events.simulation import SimulationOptions, simulate_sequence, warn_of_fill_factor
    from tasks.footage import Footage

    frames = open_source_frames(path, footage)
    simulate_frames: Callable[..., tuple[int, ReadoutReport | None]]
    if isinstance(frames, Footage):
        for name, value in (("truth", truth), ("imu", imu.imu)):
            if value is not None:
                raise TaskError(f"{path}: --{name} needs a rendered clip, found footage")
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
        count, report = simulate_frames(model, out, options, on_progress=on_progress)
    terminal.say(f"{out}: {count} events of {model.width}x{model.height} px")
    if report is not None:
        terminal.say(f"bus: {report}")


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

    Formats: dsec (.h5, .hdf5), evt3 and evt2 (.raw), npz (.npz), text (.txt); to read, also
    csv (.csv), aedat3 (.aedat), aedat4 (.aedat4), dat (.dat), es (.es) and bag (.bag); your own as
    package.module:Format. A warning names what OUT cannot hold; ground truth and IMU are kept from
    DSEC to DSEC.

    Parameters
    ----------
    format
        Format of OUT, instead of what its extension says; .raw is EVT3 by default.
    input_format
        Format of IN, instead of what its extension or header says.
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
