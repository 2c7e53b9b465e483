"""The command that turns a file of events into images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.app import WeightsFiles
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.recording.options import USUAL_VIDEO, VideoOptions


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

    Writes PNG files, and timestamps.txt with their times. A high-pass filter needs seconds to fill
    the image. Each image is stretched from its 1st percentile to its 99th.

    Parameters
    ----------
    out
        Folder of the images, new or with images of an earlier call.
    calibration
        File of the lens, fx fy cx cy k1 k2 p1 p2 k3; its distortion is removed from the images.
    weights
        Files of networks' weights as METHOD=FILE, or a FILE for the one method that needs weights.
    format
        Format of the file, as for `eres info`, instead of what its extension says.
    overwrite
        Replace the images of an earlier call.
    """
    from tasks.methods.networks import named_weights
    from tasks.recording.calibration import read_calibration
    from tasks.recording.recording import open_recording
    from tasks.recording.video import write_video

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
