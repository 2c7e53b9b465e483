"""What a recording shows about its sensor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.table import Table
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, Reading


def fit(
    recording: Annotated[Positional[Path], arg(metavar="RECORDING", help="file of events")],
    out: Path,
    still: tuple[float, float] | None = None,
    frames: Path | None = None,
    frames_fps: float | None = None,
    frames_time_unit: str | None = None,
    frames_encoding: str | None = None,
    dark: float = 1e-3,
    steps: str | None = None,
    title: str | None = None,
    format: str | None = None,
    overwrite: bool = False,
    reading: OmitArgPrefixes[Reading] = AS_STORED,
) -> None:
    """Estimate a sensor's electronics from a recording.

    They are written as a profile. Noise and hot pixels come from a stretch in which nothing moves;
    contrast thresholds from frames on the clock of the events; cutoff and latency from steps of the
    light at known times. Each number has a 95 % interval. `eres simulate --profile` takes the
    profile.

    Parameters
    ----------
    out
        The profile to write, a TOML file.
    still
        Start and end of a stretch in which nothing moves, seconds after the first event.
    frames
        Video or folder of images of the sensor's size, with times on the clock of the events, such
        as those of a DAVIS.
    frames_fps
        Frames per second, unless the folder has a timestamps.txt.
    frames_time_unit
        Unit of timestamps.txt: s, ms, us or ns.
    frames_encoding
        Transfer function of the frames: srgb, rec709, linear, or gamma:2.2; frames of a DAVIS are
        linear. By default as for `eres simulate`.
    dark
        Dark level for the thresholds, share of white; the printed sweep shows how much it decides.
    steps
        File with the times at which the light steps up, microseconds on the clock of the events,
        one a line; or triggers, the rising edges in the recording.
    title
        Name of the sensor; by default that of the recording.
    format
        Format of the recording, instead of what its extension or header says.
    overwrite
        Replace OUT if it exists.
    """
    from sensor.events import concatenate
    from tasks.cli.progress_bar import progress_bar
    from tasks.events.overwriting import check_new
    from tasks.fitting.fit import Evidence
    from tasks.fitting.fit import fit as fit_recording
    from tasks.fitting.profile_file import write_profile
    from tasks.fitting.steps import read_steps
    from tasks.footage import open_footage

    if out.suffix != ".toml":
        raise TaskError(f"{out}: found {out.suffix or 'no extension'!r}, expected .toml")
    check_new(out, overwrite)
    footage = None
    if frames is not None:
        footage = open_footage(
            frames, fps=frames_fps, time_unit=frames_time_unit, encoding=frames_encoding
        )
    elif (frames_fps, frames_time_unit, frames_encoding) != (None, None, None):
        raise TaskError("frames-fps, frames-time-unit, frames-encoding: expected --frames too")
    evidence = Evidence(
        still_s=still,
        frames=footage,
        dark_share=dark,
        rises_us=None if steps is None else read_steps(steps, recording, format),
    )
    events = concatenate(list(reading.parts(recording, format)))
    with progress_bar(terminal.err) as on_progress:
        found = fit_recording(events, evidence, on_progress)
    fields = found.fields(recording.name)
    write_profile(out, title or recording.name, fields)
    table = Table("field", "value", "unit", box=None)
    for name, (value, unit, _) in fields.items():
        table.add_row(name, str(value), unit)
    terminal.out.print(table, crop=False)
    if found.sweep:
        sweep = Table("dark level, % of white", "ON, log", "OFF, log", box=None)
        for one in found.sweep:
            sweep.add_row(f"{100 * one.dark_share:g}", str(one.on), str(one.off))
        terminal.out.print(sweep, crop=False)
        terminal.out.print(found.sentence(), soft_wrap=True)
    if found.response is not None:
        early, middle, late = (1e6 * one for one in found.response.first_event_s)
        terminal.out.print(
            f"first event of a pixel after a step: {middle:.4g} us, for 90 % of them from "
            f"{early:.4g} to {late:.4g} us",
            soft_wrap=True,
        )
    terminal.out.print(f"{out}: {len(fields)} fields", soft_wrap=True)
