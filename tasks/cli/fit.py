"""What a recording shows about its sensor."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from tasks.cli import terminal
from tasks.cli.table import Table
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, Reading
from tasks.recording.options import NO_FRAMES, FrameOptions

if TYPE_CHECKING:
    from tasks.fitting.fit import Found


def fit(
    recording: Annotated[Positional[Path], arg(metavar="RECORDING", help="file of events")],
    out: Path,
    still: tuple[float, float] | None = None,
    crop: Path | None = None,
    motion: bool = False,
    dark: Annotated[float | None, arg(help_behavior_hint="(default: 0.001)")] = None,
    steps: str | None = None,
    title: str | None = None,
    format: str | None = None,
    overwrite: bool = False,
    reading: OmitArgPrefixes[Reading] = AS_STORED,
    frames: OmitArgPrefixes[FrameOptions] = NO_FRAMES,
) -> None:
    """Estimate a sensor's electronics from a recording.

    Writes a profile for `eres simulate --profile`. Noise and hot pixels come from a stretch in
    which nothing moves; contrast thresholds from frames on the clock of the events; cutoff and
    latency from steps of the light at known times, or from the motion between the frames. Each
    number has a 95 % interval; if its end is open, the number is only a bound, which is not
    simulated.

    Parameters
    ----------
    out
        The profile to write, a TOML file.
    still
        Start and end of a stretch in which nothing moves, seconds after the first event.
    crop
        In place of frames, the folder that `eres rig crop` made of this recording: the light is
        its page, seen from the solved poses.
    motion
        Also estimate cutoff and latency from frames or crop: how late and how smooth the events
        are, compared with the light along the motion of the image.
    dark
        Dark level for thresholds and motion, as a share of white: the largest value that the
        frames' files can store, for floats the 99.9th percentile of the first frame. The printed
        sweep shows how much the thresholds depend on it.
    steps
        File with the times at which the light steps up, microseconds on the clock of the events,
        one per line; or triggers, for the rising edges in the recording, triggers:1 for those on
        channel 1.
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
    from tasks.fitting.fit import USUAL_DARK, Evidence
    from tasks.fitting.fit import fit as fit_recording
    from tasks.fitting.profile_file import write_profile
    from tasks.fitting.steps import read_steps
    from tasks.origin import in_text
    from tasks.recording.clock import on_one_clock
    from tasks.recording.pairs import check_frames
    from tasks.recording.recording import open_recording
    from tasks.rig.light import light_of_crop

    if out.suffix != ".toml":
        raise TaskError(f"{out}: found {out.suffix or 'no extension'!r}, expected .toml")
    check_new(out, overwrite, recording)
    if motion and frames.estimate_shift:
        raise TaskError(
            "motion, estimate-shift: found both, expected one of them; an estimated shift would "
            "hide the latency"
        )
    if dark is not None and frames.frames is None and crop is None:
        raise TaskError(f"dark: found {dark:g}, expected it only with --frames or --crop")
    shift_us, opened = frames.shift_us, frames.open_frames()
    notes: list[str] = []
    if opened is not None:
        camera = open_recording(recording, format=format, reading=reading)
        if shift_us == 0:
            check_frames(camera, opened)
        else:
            opened = on_one_clock(camera, opened, shift_us, notes)
    evidence = Evidence(
        still_s=still,
        frames=opened,
        light=None if crop is None else light_of_crop(crop),
        motion=motion,
        dark_share=USUAL_DARK if dark is None else dark,
        rises_us=None if steps is None else read_steps(steps, recording, format),
    )
    events = concatenate(list(reading.parts(recording, format)))
    if not len(events):
        raise TaskError(f"{recording}: found no events, expected some")
    with progress_bar(terminal.err) as on_progress:
        found = fit_recording(events, evidence, on_progress)
    fields = found.fields(in_text(recording.name))
    write_profile(out, in_text(title or recording.name), fields, overwrite=overwrite)
    table = Table("field", "value", "unit", box=None)
    for name, (value, unit, _) in fields.items():
        table.add_row(name, str(value), unit)
    terminal.out.print(table, crop=False)
    if found.sweep:
        sweep = Table("dark level, % of white", "ON, log", "OFF, log", box=None)
        for one in found.sweep:
            sweep.add_row(f"{100 * one.dark:g}", str(one.on), str(one.off))
        terminal.out.print(sweep, crop=False)
    _print_remarks(found, shift_us if crop is None else None)
    for note in notes:
        terminal.out.print(note, soft_wrap=True, highlight=False)
    terminal.out.print(f"{out}: {len(fields)} fields", soft_wrap=True)


def _print_remarks(found: Found, shift_us: int | None) -> None:
    """Print what the fields of the profile do not say; frames were shifted by `shift_us`."""
    from tasks.recording.motion import NOISY

    if found.thresholds is not None:
        terminal.out.print(found.sentence(), soft_wrap=True)
        if found.thresholds.unexplained > NOISY:
            terminal.out.print(
                f"the thresholds leave {100 * found.thresholds.unexplained:.0f} % of the change of "
                "the light unexplained, and may be too low by as much: between frames it changes "
                "more than they show; more frames, or slower motion, help",
                soft_wrap=True,
            )
    if found.motion is not None:
        terminal.out.print(
            f"delay of slow changes: {found.motion.delay_s} s; "
            f"{100 * found.motion.unexplained:.0f} % of the change of the light stays unexplained",
            soft_wrap=True,
        )
        if found.motion.may_be_a_shift:
            advice = ""
            if shift_us is not None:
                option = f"--frames-shift-us {shift_us + round(found.motion.shift_us)}"
                advice = f": if it is one, {option} removes it"
            terminal.out.print(f"{found.motion.shift_sentence()}{advice}", soft_wrap=True)
    if found.response is not None:
        early, middle, late = (1e6 * one for one in found.response.first_event_s)
        terminal.out.print(
            f"first event of a pixel after a step: {middle:.4g} us, for 90 % of them from "
            f"{early:.4g} to {late:.4g} us",
            soft_wrap=True,
        )
