"""The command that shows events and rendered clips."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional

from tasks.cli import terminal
from tasks.cli.app import require, several
from tasks.errors import UsageError
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.view.look import ALL_OF_IT, Look


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
    the window. The caption has the size and cutoff of the sensor, if the file has them, and the
    rate.

    Parameters
    ----------
    out
        File to write: .mp4, .gif or .webp; .png, one picture; .html, a page that plays events
        without a network; .rrd, a recording for the Rerun viewer.
    rerun
        Open the Rerun viewer instead (in a checkout: pip install '.[viewer]').
    over
        Draw the events over the frames of this rendered clip.
    show
        What to draw of rendered clips: their frames, or their true depth or optical flow.
    format
        Format of the files of events, as for `eres info`, instead of what their extensions say.
    overwrite
        Replace an existing file.
    """
    from tasks.view.view import view as write_view

    require(sources, "source")
    if rerun == (out is not None):
        raise UsageError("give either --out FILE, such as events.mp4, or --rerun")
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
