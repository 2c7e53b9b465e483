"""What a recording shows about its sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, Positional, arg

from sensor import EventCamera, find_camera, plain_camera, write_camera
from tasks.cli import terminal
from tasks.errors import TaskError
from tasks.events.reading import AS_STORED, ReadOptions
from tasks.recording.options import NO_FRAMES, FrameOptions

if TYPE_CHECKING:
    from tasks.fitting.fit import Found


def fit(
    recording: Annotated[Positional[Path], arg(metavar="RECORDING", help="file of events")],
    out: Path,
    sensor: str | None = None,
    still: tuple[float, float] | None = None,
    crop: Path | None = None,
    motion: bool = False,
    dark: float | None = None,
    steps: str | None = None,
    check: Literal["second", "first", "none"] | None = None,
    title: str | None = None,
    format: str | None = None,
    overwrite: bool = False,
    reading: OmitArgPrefixes[ReadOptions] = AS_STORED,
    frames: OmitArgPrefixes[FrameOptions] = NO_FRAMES,
) -> None:
    """Estimate a sensor's electronics from a recording.

    Writes a camera for `eres simulate --sensor`. Noise and hot pixels come from a stretch in which
    nothing moves; contrast thresholds and dark level from frames on the clock of the events; cutoff
    and latency from steps of the light at known times, or from the motion between the frames.

    Each number has a 95 % interval. If one end is open, the number is only a bound, which is not
    simulated. With frames or a crop, one half is held out: the fitted camera is simulated in its
    light and compared with its events.

    Parameters
    ----------
    out
        The camera to write, a TOML file.
    sensor
        Camera to complete: a name (`eres sensors` lists them), or a TOML file. Its values stay
        where the recording shows none. By default a plain sensor of the recording's size.
    still
        Start and end of a stretch in which nothing moves, seconds after the first event.
    crop
        In place of frames, the folder that `eres rig crop` made of this recording: the light is
        its page, seen from the solved poses.
    motion
        Also estimate cutoff and latency from frames or crop: how late and how smooth the events
        are, compared with the light along the motion of the image.
    dark
        Dark level, as a share of white: the largest value that the frames' files can store, for
        floats the 99.9th percentile of the first frame. By default the level at which dark and
        bright pixels fire in the same proportion as in the recording.
    steps
        File with the times at which the light steps up, microseconds on the clock of the events,
        one per line. Or triggers, for the rising edges in the recording; triggers:1 for those on
        channel 1.
    check
        Half of the frames or the crop to hold out of the fit and compare with a simulation: second
        (by default), first, or none, to fit both halves.
    title
        Name of the sensor; by default that of --sensor or of the recording.
    format
        Format of the recording, as for `eres info`.
    overwrite
        Replace OUT if it exists.
    """
    from sensor.events import concatenate
    from tasks.events.overwriting import check_new
    from tasks.fitting import fit as fitting
    from tasks.fitting.response import read_steps
    from tasks.origin import in_text
    from tasks.recording.clock import on_one_clock
    from tasks.recording.frames import check_frames
    from tasks.recording.recording import open_recording
    from tasks.rig.crop import light_of_crop

    if out.suffix != ".toml":
        raise TaskError(f"{out}: expected a name that ends in .toml")
    check_new(out, overwrite, recording)
    if motion and frames.estimate_shift:
        raise TaskError("give --motion or --estimate-shift, not both: a shift hides the latency")
    shift_us, opened = frames.shift_us, frames.open_frames()
    notes: list[str] = []
    if opened is not None:
        real = open_recording(recording, format=format, reading=reading)
        if shift_us == 0:
            check_frames(real, opened)
        else:
            opened = on_one_clock(real, opened, shift_us, notes)
    has_light = opened is not None or crop is not None
    evidence = fitting.Evidence(
        still_s=still,
        frames=opened,
        light=None if crop is None else light_of_crop(crop),
        motion=motion,
        dark_share=dark,
        rises_us=None if steps is None else read_steps(steps, recording, format),
        check=check or ("second" if has_light else "none"),
    )
    events = concatenate(list(reading.parts(recording, format)))
    if not len(events):
        raise TaskError(f"{recording}: has no events")
    size = events.width, events.height
    known = plain_camera(*size) if sensor is None else find_camera(sensor)
    known = known.on(*size) if known.width is None else known
    if known.size != size:
        sizes = f"{known.width}x{known.height} px, but {recording} has {size[0]}x{size[1]} px"
        raise TaskError(f"--sensor: {sensor} has {sizes}; choose a camera of the latter size")
    with terminal.progress() as on_progress:
        estimates = fitting.fit(events, replace(evidence, camera=known), on_progress)
    name, title = in_text(out.stem), in_text(title or known.title or recording.name)
    fitted = replace(estimates.camera(known, in_text(recording.name)), name=name, title=title)
    write_camera(out, fitted, overwrite=overwrite)
    _print_tables(estimates)
    terminal.say(*_remarks(estimates, known, shift_us if crop is None else None))
    terminal.say(*notes, fitted.assumptions(), f"{out}: {len(estimates.values(''))} values")


def _print_tables(result: Found) -> None:
    """Print the estimates, the dark levels that were tried, and the held-out half."""
    from tasks.fitting.check import BLOCKS

    table = terminal.Table("field", "value", "unit")
    for name, (value, unit, _, _) in result.values("").items():
        table.add_row(name, str(value), unit)
    terminal.show(table)
    if result.sweep:
        columns = "dark level, % of white", "ON, log", "OFF, log", "spread over brightness, %"
        sweep = terminal.Table(*columns)
        for (on, off, dark, *_), uneven in result.sweep:
            sweep.add_row(f"{100 * dark:g}", str(on), str(off), f"{100 * uneven:.1f}")
        terminal.show(sweep)
    if (held_out := result.agreement) is not None:
        start_s, end_s = (1e-6 * t_us for t_us in held_out.counted_us)
        sides = "real", "simulated", "simulated / real"
        table = terminal.Table(f"held out, {start_s:.4f} to {end_s:.4f} s", *sides)
        counts = [(*signs, sum(signs)) for signs in (held_out.real, held_out.simulated)]
        names = "ON events", "OFF events", "events"
        for name, real, simulated in zip(names, *counts, strict=True):
            ratio = f"{simulated / real:.3f}" if real else ""
            table.add_row(name, str(real), str(simulated), ratio)
        quartiles = ", ".join(f"{ratio:.2f}" for ratio in held_out.quartiles)
        table.add_row(f"the same in {BLOCKS} x {BLOCKS} blocks, quartiles", "", "", quartiles)
        real_us, simulated_us = held_out.real_us, held_out.simulated_us
        ms = f"{1e-3 * real_us:.3g}", f"{1e-3 * simulated_us:.3g}"
        table.add_row("median inter-event interval, ms", *ms, f"{simulated_us / real_us:.3f}")
        terminal.show(table)


def _remarks(result: Found, known: EventCamera, shift_us: int | None) -> Iterator[str]:
    """Yield what the values do not say; frames were shifted by `shift_us`."""
    from tasks.recording.motion import NOISY

    dark, thresholds, motion = result.dark, result.thresholds, result.motion
    if dark is not None and dark.is_bound:
        share = f"{100 * known.dark_share:g} %"
        yield f"dark level: only a bound, {dark} of white; the thresholds assume {share}"
    if thresholds is not None and thresholds.unexplained > NOISY:
        yield (
            f"the thresholds leave {100 * thresholds.unexplained:.0f} % of the change of the light "
            "unexplained, and may be too low by as much: the light between frames is not known "
            "well enough. More frames or slower motion help."
        )
    if motion is not None:
        rest = f"{100 * motion.unexplained:.0f} % of the change of the light stays unexplained"
        yield f"delay of slow changes: {motion.delay_s} s; {rest}"
        if motion.may_be_a_shift:
            advice = ""
            if shift_us is not None:
                option = f"--frames-shift-us {shift_us + round(motion.shift_us)}"
                advice = f"; if it is a shift, {option} removes it"
            yield f"{motion.shift_sentence()}{advice}"
    if result.response is not None:
        early, middle, late = (f"{1e6 * t_s:.4g}" for t_s in result.response.first_event_s)
        usual = f"for 90 % of the pixels from {early} to {late} us"
        yield f"first event of a pixel after a step: {middle} us, {usual}"
