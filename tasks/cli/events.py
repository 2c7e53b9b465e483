"""Files of events: simulated and converted."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.events.sensor_options import IDEAL_PIXEL, NO_BUS, BusOptions, PixelOptions


def simulate(
    path: Annotated[Positional[Path], arg(metavar="SEQUENCE", help="folder of a clip")],
    out: Path,
    sensor: str | None = None,
    resolution: int | None = None,
    threshold: float | None = None,
    speed: float = 1.0,
    seed: int = 0,
    format: str | None = None,
    truth: float | None = None,
    overwrite: bool = False,
    pixel: OmitArgPrefixes[PixelOptions] = IDEAL_PIXEL,
    bus: OmitArgPrefixes[BusOptions] = NO_BUS,
) -> None:
    """Turn a rendered sequence into a file of events, frame by frame.

    The dark level is a thousandth of the sequence's white. A sensor that is not of the frames'
    shape sees the middle of them. Events of the warm-up are in the file too; it says, where its
    format can, when the window starts and ends, and which sensor and seed made it.

    Parameters
    ----------
    out
        File of events: .h5 (DSEC), .raw (Prophesee EVT3), .npz or .txt.
    sensor
        A camera by name; `eres sensors` lists them. This or a resolution.
    resolution
        Width of the sensor, px.
    threshold
        Contrast threshold in log units; 0.2 by default.
    speed
        How much faster the scene moves than it was rendered.
    seed
        Seed of everything random in the sensor.
    format
        dsec, evt3, evt2, npz or text, in place of what the file's extension says.
    truth
        Add true depth, flow and poses to a DSEC file, this many seconds apart.
    overwrite
        Replace the file if it exists; without it such a file is refused.
    """
    from eres_render import open_sequence
    from tasks.cli.progress_bar import progress_bar
    from tasks.events.simulation import sensor_for, simulate_sequence

    sequence = open_sequence(path)
    model = sensor_for(
        sequence,
        sensor=sensor,
        resolution=resolution,
        contrast_threshold=threshold,
        pixel=pixel,
    )
    with progress_bar(terminal.err) as on_progress:
        count, report = simulate_sequence(
            sequence,
            model,
            out,
            speed=speed,
            seed=seed,
            readout=bus.readout(),
            truth_step_s=truth,
            format=format,
            overwrite=overwrite,
            on_progress=on_progress,
        )
    terminal.out.print(f"{out}: {count} events of {model.width}x{model.height} px", soft_wrap=True)
    if report is not None:
        terminal.out.print(f"bus: {report}", soft_wrap=True)


def convert(
    source: Annotated[Positional[Path], arg(metavar="IN", help="file of events")],
    out: Annotated[Positional[Path], arg(metavar="OUT", help="file to write")],
    format: str | None = None,
    input_format: str | None = None,
    size: tuple[int, int] | None = None,
    overwrite: bool = False,
) -> None:
    """Write a file of events in another format.

    Formats: dsec (.h5, .hdf5), evt3 and evt2 (.raw), npz (.npz), text (.txt). A warning names what
    OUT cannot hold of IN; truth is kept from DSEC to DSEC.

    Parameters
    ----------
    format
        The format of OUT, in place of what its extension says; a .raw is EVT3 by default.
    input_format
        The format of IN, in place of what its extension or header says.
    size
        Width and height of the sensor, for files that do not store it.
    overwrite
        Replace OUT if it exists; without it such a file is refused.
    """
    from tasks.events.conversion import convert as convert_file

    count = convert_file(
        source,
        out,
        format=format,
        input_format=input_format,
        size=size,
        overwrite=overwrite,
    )
    terminal.out.print(f"{out}: {count} events", soft_wrap=True)
